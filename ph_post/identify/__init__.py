"""Drive parameters from a log: b, c, lost motion, η and β, with their standard errors."""
