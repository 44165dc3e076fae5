"""Changes to a part program: planned on its motion, written into its bytes, taken back."""
