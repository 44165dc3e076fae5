"""Prove that a compensated program is its original but for what its header declares."""
