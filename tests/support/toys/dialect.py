"""A dialect by the recipe: an RS274 controller that counts micrometres and knows no arcs."""

from ph_post.dialects.base import Abilities, Dialect, NumberFormat, Syntax, metric_opening

DIALECT = Dialect(
    name="toy",
    syntax=Syntax(opening=metric_opening, closing=("M30",), max_line=255),
    abilities=Abilities(arc_planes=()),
    numbers=NumberFormat(decimals=3, feed_digits=4),
)
