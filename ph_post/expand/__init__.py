"""Write programs out that compute: parameters, loops, subprograms and cycles become plain motions."""
