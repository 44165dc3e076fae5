"""The judge of the corpus, on programs whose places are plain to see."""

import numpy as np

from .corpus_judge import played_places


def test_motors_that_were_let_go_stand_where_nobody_knows():
    places, cuts = played_places("marlin", b"G92 X0 Y0\nG1 X1 Y0 F900\nM18\nG1 X3 Y2\nG1 X3 Y4\n")
    assert places[0].tolist() == [0.0, 0.0, 0.0]
    drawn = places[np.flatnonzero(cuts)]
    assert drawn[drawn[:, 1] == 0.0][:, 0].max() == 1.0
    # What leads from where they were pushed to is no cut, and what is behind it is one again.
    assert drawn[drawn[:, 1] > 0.0][:, 0].tolist() == [3.0] * int((drawn[:, 1] > 0.0).sum())


def test_a_small_circle_of_a_long_program_is_sampled_as_finely_as_it_needs():
    lines = "".join(f"G1 X{x}\nG1 X0\n" for x in [9000] * 20)
    places, cuts = played_places("grbl", f"G21 G90 F900\nG0 X0 Y0\nG1 X1\n{lines}G3 X0 Y0 I0 J0.2\nM2\n".encode())
    arc = places[cuts & (places[:, 1] > 1e-9)]
    assert np.linalg.norm(np.diff(arc, axis=0), axis=1).max() < 0.051
