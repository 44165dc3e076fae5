"""Physical effects beyond backlash, one file each."""
