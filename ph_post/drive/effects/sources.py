"""Literature that several effects share."""

from __future__ import annotations

from typing import Final

FRICTION: Final = (
    "B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit: A survey of models, analysis tools and "
    "compensation methods for the control of machines with friction, Automatica 30 (1994), "
    "doi:10.1016/0005-1098(94)90209-7"
)

FEED_DRIVES: Final = (
    "Y. Altintas, A. Verl, C. Brecher, L. Uriarte, G. Pritschow: Machine tool feed drives, "
    "CIRP Annals 60 (2011), doi:10.1016/j.cirp.2011.05.010"
)

TEST_CODE: Final = "ISO 230-1: Test code for machine tools, part 1: Geometric accuracy, 2012"

POSITIONING: Final = "ISO 230-2: Test code for machine tools, part 2: Positioning accuracy, 2014"

THERMAL: Final = "ISO 230-3: Test code for machine tools, part 3: Determination of thermal effects, 2020"

CUTTING: Final = (
    "Y. Altintas: Manufacturing Automation: Metal Cutting Mechanics, Machine Tool Vibrations, "
    "and CNC Design, 2nd ed., Cambridge University Press 2012"
)
