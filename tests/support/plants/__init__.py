"""Hidden plants: axes whose effects nobody is told, integrated by their own equations.

Nothing here comes from the simulator or from its effects: the equations are those of the paper, §3.1 to §3.4,
and of textbooks, so that a mistake in a model cannot hide itself.
"""
