"""Many jobs at once: every program of a folder for every machine, on the processes of this or of other computers."""
