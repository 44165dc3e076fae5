"""Part programs read without loss: their bytes, their words, their modal state and their motion."""
