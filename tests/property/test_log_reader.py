"""Whatever stands in a log, it is read or refused in one line; nothing else ever comes out."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.amount import examples

from ph_post.errors import InputError
from ph_post.identify.logprogram import read_log

K = np.arange(240)
X = 10.0 * np.sin(2 * np.pi * K / 150)
NAMED = "# X_act.side: unknown\nt,X_cmd,X_act\n" + "".join(
    f"{k * 0.002:.3f},{x:.3f},{x - 0.01:.3f}\n" for k, x in enumerate(X)
)
SAMPLED = "".join(f"{k} {x:f} {x - 0.01:f} \n" for k, x in enumerate(X))
LOGS = ((NAMED.encode(), ()), (SAMPLED.encode(), ("t=1:ms", "X_cmd=2", "X_act=3")))
WORDS = [
    b",",
    b";",
    b"\t",
    b'"',
    b"\n",
    b"\r",
    b"#",
    b"nan",
    b"inf",
    b"-",
    b"1e400",
    b"1e-400",
    b"1_0",
    b"0x1",
    b"\0",
    b"\xff",
    b"overrun\n",
    b"1,5",
    b"e",
    b"\xe2\x80\xa8",
    b"\x0c",
    "٣".encode(),
    b'"""',
    b"9" * 400,
    b"X_cmd",
    b":",
]


@st.composite
def mangled(draw):
    data, columns = draw(st.sampled_from(LOGS))
    text = bytearray(data)
    for _ in range(draw(st.integers(1, 3))):
        place = draw(st.integers(0, len(text)))
        length = draw(st.integers(0, 40))
        text[place : place + length] = draw(st.one_of(st.sampled_from(WORDS), st.binary(max_size=4), st.just(b"")))
    return bytes(text), columns


def takes_or_refuses(file, data, columns):
    file.write_bytes(data)
    try:
        log = read_log(file, columns=columns)
    except InputError as refusal:
        line = str(refusal)
        assert line.splitlines() == [line]
        assert line.startswith(str(file))
        return
    steps = np.diff(log.t)
    assert steps == pytest.approx(np.full(steps.size, log.period), rel=1e-6)
    assert np.isfinite(log.axes["X"].command).all()


@settings(max_examples=examples(200), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(case=mangled())
def test_a_damaged_log_is_read_or_refused_in_one_line(case, tmp_path):
    takes_or_refuses(tmp_path / "run.csv", *case)


@settings(max_examples=examples(100), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.binary(max_size=300), ending=st.sampled_from(["csv", "mat", "npz", "txt"]))
def test_bytes_that_are_no_log_are_refused_in_one_line(data, ending, tmp_path):
    file = tmp_path / f"run.{ending}"
    file.write_bytes(data)
    with pytest.raises(InputError) as refusal:
        read_log(file)
    assert len(str(refusal.value).splitlines()) == 1
    assert str(refusal.value).startswith(str(file))
