"""How a controller runs a program: look-ahead, corners, stops and dwells, sampled every servo period."""
