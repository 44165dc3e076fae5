"""Variables of .mat files, against scipy's reader of them."""

import io

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from ph_post.errors import InputError
from ph_post.files.matlab import mat_variables
from ph_post.identify.logprogram import read_log

VALUES = {
    "column": np.arange(5.0)[:, None],
    "single": np.float32([[1, 2.5]]),
    "whole": np.array([[1, -2, 300]]),
    "large": np.array([[2**40]]),
    "bytes": np.uint8([[1, 2]]),
    "truths": np.array([[True, False]]),
    "one": 3.25,
    "table": np.arange(6.0).reshape(2, 3),
    "nothing": np.zeros((0, 0)),
}
OTHERS = {"complex": np.array([1 + 2j]), "cells": np.array([[1], ["a"]], dtype=object), "structure": {"a": 1}}


@pytest.mark.parametrize("compressed", [False, True])
def test_variables_are_those_that_scipy_reads(compressed):
    file = io.BytesIO()
    savemat(file, {**VALUES, **OTHERS, "words": "Maßstab 5 µm"}, do_compression=compressed)
    found, wanted = mat_variables(file.getvalue()), loadmat(file)
    for name in VALUES:
        assert np.array_equal(found.pop(name), wanted[name])
    assert found.pop("words") == wanted["words"].item()
    assert found == dict.fromkeys(OTHERS)


@pytest.mark.parametrize("compressed", [False, True])
def test_a_damaged_file_is_refused_or_read_and_never_ends_the_program(compressed, tmp_path):
    file, k = io.BytesIO(), np.arange(250)
    savemat(file, {"t": 0.001 * k, "X_cmd": 1.0 * k, "X_act": 1.0 * k}, do_compression=compressed)
    whole = file.getvalue()
    lines = []
    for place in range(100, len(whole), 23 if compressed else 97):
        damaged = bytearray(whole)
        damaged[place] ^= 0xFF
        for data in (damaged, whole[:place]):
            (tmp_path / "run.mat").write_bytes(data)
            try:
                read_log(tmp_path / "run.mat")
            except InputError as refusal:
                lines.append(str(refusal).splitlines())
    assert len(lines) > 40
    assert {len(line) for line in lines} == {1}
