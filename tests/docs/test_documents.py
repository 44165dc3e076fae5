"""README and docs: what they name exists, what they list is complete, and their links lead somewhere."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest

from ph_post.cli.main import COMMANDS
from ph_post.compensate.strategies.registry import strategy_names
from ph_post.dialects.registry import dialect_names
from ph_post.drive.effects.registry import CATALOGUE, effect_names, find_effect

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
README = ROOT / "README.md"
DOCUMENTS = [README, ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *sorted(DOCS.glob("*.md"))]


def text_of(name: str) -> str:
    return (DOCS / name).read_text(encoding="utf-8")


def anchors(document: Path) -> set[str]:
    """Return the anchors of a document's headings, as they are made of their words."""
    headings = re.findall(r"^#+ (.*)$", document.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_the_readme_is_short() -> None:
    assert 800 <= len(README.read_text(encoding="utf-8").split()) <= 1100


def test_two_commands_do_all_the_set_up_and_ci_runs_the_second() -> None:
    commands = [line for line in README.read_text().splitlines() if line.startswith("python3 -m venv")]
    assert len(commands) == 2
    script = [line.removesuffix(" || status=$?") for line in (ROOT / ".ci" / "run").read_text().splitlines()]
    assert "set -euo pipefail" in script  # which makes of lines what && makes of the command
    parts = commands[1].split(" && ")
    assert [line for line in script if line in parts] == parts


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda file: file.name)
def test_links_lead_somewhere(document: Path) -> None:
    text = re.sub(r"```.*?```", "", document.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if target.startswith(("http://", "https://")):
            continue
        name, _, anchor = target.partition("#")
        file = (document.parent / name) if name else document
        assert file.exists(), target
        assert not anchor or anchor in anchors(file), target


def test_every_command_stands_in_the_readme_or_the_pipelines() -> None:
    said = README.read_text(encoding="utf-8") + text_of("pipelines.md") + text_of("machine-file.md")
    assert [name for name in COMMANDS if f"ph-post {name}" not in said and f"ph-post-{name}" not in said] == [
        "completion"
    ]
    assert all(f"## ph-post {name}\n" in text_of("cli.md") for name in COMMANDS)


def test_every_strategy_and_dialect_is_described() -> None:
    assert all(f"| `{name}` |" in text_of("strategies.md") for name in strategy_names())
    assert all(f"`{name}`" in text_of("pipelines.md") for name in dialect_names())


def test_every_effect_is_described_with_every_parameter() -> None:
    rows = dict(re.findall(r"^\| `(\w+)` \| (.*) \|$", text_of("effects.md"), re.MULTILINE))
    assert set(rows) == set(effect_names())
    assert set(rows) <= set(CATALOGUE)
    for name, row in rows.items():
        effect = find_effect(name)
        words = set(re.findall(r'`"?(\w+)"?`', row))
        wanted = {one.name for one in effect.parameters} | {w for one in effect.parameters for w in one.choices}
        assert wanted <= words
        assert words <= wanted | {"c", "standstill", "load", "motor"}


@pytest.mark.parametrize("document", ["architecture.md", "method.md"])
def test_the_code_that_is_named_stands_there(document: str) -> None:
    """Backticks hold `room/module.py`, or `room/module.py: function`."""
    named = re.findall(r"`((?:tests/)?[\w/]+\.py)(?:: (\w+))?`", text_of(document))
    assert len(named) > 5
    for file, function in named:
        path = ROOT / file if file.startswith("tests/") else ROOT / "ph_post" / file
        assert path.is_file(), file
        if function:
            module = importlib.import_module(f"ph_post.{file[:-3].replace('/', '.')}")
            assert hasattr(module, function), f"{file}: {function}"
