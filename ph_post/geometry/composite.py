"""Many polynomial pieces that are one curve."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from ph_post.geometry import fractional
from ph_post.geometry.base import MEETS, PiecewiseCurve, extent, require, require_length
from ph_post.geometry.piece import ExactPiece, Piece


class Composite(PiecewiseCurve):
    """Polynomial pieces that meet, as one curve; their control points are the data.

    Made for what comes by the thousand, so that a piece costs no more than its record.

    Parameters
    ----------
    pieces : sequence of Piece
        In order, each beginning in xi where the one before ends.

    Raises
    ------
    InputError
        Pieces that are not polynomial, or a length of zero.

    Examples
    --------
    >>> import numpy as np
    >>> from ph_post.geometry.base import polynomial_piece
    >>> ends = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]])
    >>> curve = Composite([polynomial_piece(ends[k : k + 2], k, k + 1) for k in (0, 1)])
    >>> curve.length, curve.domain
    (3.0, (0.0, 2.0))
    """

    kind: ClassVar[str] = "composite"

    def __init__(self, pieces: Sequence[Piece]) -> None:
        kinds = {piece.kind for piece in pieces}
        require(kinds == {"polynomial"}, "wrong pieces", expected="polynomial", got=", ".join(sorted(kinds)))
        longest = next((piece for piece in pieces if extent(piece.control) > MEETS), pieces[0])
        require_length(extent(longest.control))
        super().__init__(tuple(pieces))

    @property
    def built_exactly(self) -> bool:
        """Whether the control points are the given numbers themselves: they are."""
        return True

    def exact_pieces(self) -> tuple[ExactPiece, ...]:
        """Return the control points in exact numbers."""
        return tuple(
            ExactPiece(kind="polynomial", control=fractional.rows(piece.control)) for piece in self.pieces
        )
