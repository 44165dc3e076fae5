"""Look for bytes that break the reader of part programs, guided by which lines of it they reach.

Run it by hand, in an environment that has atheris, from the project's folder::

    NUMBA_DISABLE_JIT=1 PYTHONPATH=. python tests/fuzz/fuzz_reader.py -max_total_time=300 -max_len=400 CORPUS

CORPUS is a folder that keeps what was found to reach further; the bad programs of ``tests/bad/programs``
make a good beginning. Without compiling, every access outside of an array is an error and not a wrong number.
It ends at the first input that is neither kept to the byte nor refused in one line, and writes it to a file.
"""

from __future__ import annotations

import sys
import warnings

try:
    import atheris
except ImportError:
    sys.exit("skipped: atheris is not installed")

with atheris.instrument_imports(include=["ph_post"]):
    from ph_post.errors import InputError
    from ph_post.gcode.read import read_program

WORDS = b"""
G1 G2 G3 X Y1.5 I5 R F100 ( ) ; % / #1 [ ] = O100 sub endsub call <a> M2 M98 *71 @1 ^2 $H G91 G20 G5 G5.2 G5.3
P1 Q1 J2 - . 99999999999999999999 ,R1 ABS[ G92 G41 G40 G81 G80 A5 E3 G18 K0 G93 G28 T1 M6 G0 X0 Y0 Z0 G4 G53
G68 G90.1
""".split()


def one_input(data: bytes) -> None:
    """Read some bytes: as they are, or, behind a first byte of 255, as numbers of words."""
    if data[:1] == b"\xff":
        data = b"".join(WORDS[c % len(WORDS)] if c < 200 else b"\n" if c > 230 else b" " for c in data[1:])
    try:
        program = read_program(data, "a.ngc")
    except InputError as refusal:
        if len(str(refusal).splitlines()) != 1:
            raise AssertionError(f"refused in more than one line: {refusal}") from None
        return
    if b"".join(program.text(block) for block in range(program.blocks)) != data:
        raise AssertionError("bytes are lost")


if __name__ == "__main__":
    warnings.simplefilter("ignore")  # hashes overflow on purpose
    atheris.Setup(sys.argv, one_input)
    atheris.Fuzz()
