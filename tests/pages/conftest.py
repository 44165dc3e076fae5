"""One browser for the tests of a module; where there is none they are skipped, and say why."""

import pytest
from support.browser import WHY_NOT, chromium


@pytest.fixture(scope="module")
def browser():
    if WHY_NOT:
        pytest.skip(WHY_NOT)
    with chromium() as found:
        yield found
