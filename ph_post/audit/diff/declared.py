"""What compensated programs say of themselves, in words, and what they are without it."""

from __future__ import annotations

from ph_post.audit.diff.outline import outline_of
from ph_post.audit.diff.travel import compare_paths, largest_deviation
from ph_post.errors import InputError
from ph_post.gcode.reader.record import PartProgram
from ph_post.gcode.reading import read_anew
from ph_post.gcode.splice.header import Declaration, read_declaration
from ph_post.gcode.splice.undo import undo
from ph_post.units import MM

Programs = tuple[PartProgram, PartProgram]


class Declared:
    """What one program declares, and the program it was made from.

    Attributes
    ----------
    words : tuple of str
        What is declared, in sentences; empty where nothing is.
    original : PartProgram
        The program without it; the program itself where nothing is declared or it cannot be taken back.
    taken_back : bool
        Whether `original` is another program.
    """

    def __init__(self, program: PartProgram) -> None:
        self.original, self.taken_back = program, False
        declaration = read_declaration(program.data)
        if declaration is None:
            self.words: tuple[str, ...] = ()
            return
        words = sentences(declaration)
        try:
            self.original = read_anew(program, undo(program.data, program.name))
            self.taken_back = True
        except InputError as error:
            words.append(f"what it declares cannot be taken off: {error}")
        self.words = tuple(words)


def sentences(one: Declaration) -> list[str]:
    """Say what a declaration says."""
    found = [f"compensated by ph-post {one.version} for {one.machine}, from sha256 {one.digest[:16]}"]
    found += [
        f"{axis} is commanded {size / MM:.4g} mm ahead in the direction it moves"
        for axis, size in sorted(one.offset.items())
    ]
    found += [
        f"{axis} is moved out and back by up to {size / MM:.4g} mm at stops"
        for axis, size in sorted(one.pulse.items())
    ]
    if one.stops or one.dips:
        found.append(f"{one.stops} stops, {one.dips} feed dips")
    return found


def apart_without(declared: tuple[Declared, Declared]) -> float | None:
    """Return how far the tool paths are apart without what is declared [m]; None where nothing is."""
    if not any(one.taken_back for one in declared):
        return None
    a, b = (outline_of(one.original.motions) for one in declared)
    return largest_deviation(compare_paths(a, b))
