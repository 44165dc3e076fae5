"""Models of controllers: look-ahead, corners, stops and dwells, sampled every servo period."""
