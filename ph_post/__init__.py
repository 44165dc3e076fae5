"""Backlash compensation of CNC toolpaths by localized feedrate modulation.

The method is that of [1]_; the code map in README.md follows one turning point through the package.

References
----------
.. [1] "Real-time compensation of backlash positional errors in CNC machines by localized feedrate
   modulation", Int. J. Adv. Manuf. Technol. 119 (2022), doi:10.1007/s00170-021-08515-z.
"""
