"""The examples in the docstrings of the public functions run as they are printed."""

import doctest
import importlib
import inspect

import pytest

import ph_post as ph

FUNCTIONS = [name for name in ph.__all__ if inspect.isroutine(getattr(ph, name))]


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.thinned(12)
def test_example(name):
    function = getattr(ph, name)
    module = importlib.import_module(function.__module__)
    (example,) = doctest.DocTestFinder(recurse=False).find(function, name, module, globs={})
    assert example.examples, f"{name} has no example"
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    said: list[str] = []
    runner.run(example, out=said.append)
    assert runner.failures == 0, "".join(said)
