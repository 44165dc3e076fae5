"""Read part programs: text, words, modal state, motions, paths; knows no machine."""
