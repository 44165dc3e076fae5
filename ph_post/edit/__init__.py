"""Changes to an existing part program: planned on its motions, written into its bytes, taken back."""
