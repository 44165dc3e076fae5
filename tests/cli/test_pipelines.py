"""`filter`, `slicer` and the Cura script as LinuxCNC, slicers and Cura call them: processes of their own."""

import importlib.util
import json
import os
import re
import shlex
import subprocess
import sys
import types

import pytest
from support.pipelines import END, ROOT, call, environment, executable, run
from support.shop import CIRCLE, SLOT

from ph_post.cli.main import COMMANDS, filter_main, slicer_main
from ph_post.edit.undo import undo

SLOT = SLOT.replace(" Q0", "")
CIRCLE = CIRCLE.replace(" Q0", "")
BAD = SLOT.replace("I0 J6", "I0 J7")
ROOMY = ("--max-slowdown", "1")
PROGRESS = re.compile(r"FILTER_PROGRESS=(\d+)")


@pytest.fixture
def part(tmp_path):
    """A program in a folder, by a name, with blanks and both kinds of quotes."""
    place = tmp_path / "it's a folder" / 'my "slot" 1.ngc'
    place.parent.mkdir()
    place.write_text(SLOT)
    return place


def one_line(done):
    """Return the line that a failed command says, beside how far it was."""
    assert done.returncode == 2
    lines = [line for line in done.stderr.decode().splitlines() if not PROGRESS.fullmatch(line)]
    assert len(lines) == 1, lines
    assert lines[0].startswith("ph-post: ")
    return lines[0]


# LinuxCNC


@pytest.mark.slow
def test_the_filter_gives_nothing_but_the_program(part, tmp_path):
    """As the screens of LinuxCNC run it: by sh, the path in single quotes, its standard input closed."""
    command = executable(tmp_path / "ph-post-filter", "filter")
    quoted = str(part).replace("'", "'\\''")
    process = subprocess.Popen(
        ["sh", "-c", f"{shlex.quote(str(command))} -m router {shlex.join(ROOMY)} '{quoted}'"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=environment(),
    )
    assert process.stdin is not None
    process.stdin.close()
    process.stdin = None
    out, err = process.communicate(timeout=END)
    assert process.returncode == 0
    assert out.startswith(b"(ph-post ")
    assert undo(out, "slot") == SLOT.encode()
    # Whoever sees nothing but the program finds the warnings in it.
    assert b"(ph-post: note warning: axes X, Y" in out
    told = [int(found[1]) for line in err.decode().splitlines() if (found := PROGRESS.fullmatch(line))]
    assert told == sorted(set(told))
    assert len(told) > 3
    assert told[-1] == 100


@pytest.mark.slow
def test_the_filter_writes_the_words_of_linuxcnc_whatever_the_machine_names(part):
    done = run("filter", "-m", "stepper", "--quiet", *ROOMY, part)
    assert done.returncode == 0
    assert done.stderr == b""
    assert undo(done.stdout, "slot") == SLOT.encode()
    path = run("filter", "-m", "stepper", "--strategy", "suppress", ROOT / "paths" / "circle.json")
    assert b"(dialect linuxcnc," in path.stdout
    assert path.stdout.startswith(b"(warning: ")
    assert b"\nG64 P0.001 Q0\n" in path.stdout


def test_the_filter_refuses_the_words_of_another_controller(part):
    assert one_line(call("filter", "-m", "stepper", "--dialect", "marlin", part)).endswith(
        "--dialect: LinuxCNC reads what is filtered; expected linuxcnc; got marlin"
    )


def test_the_filter_finds_its_machine(part, tmp_path):
    router = ROOT / "samples" / "machines" / "router.toml"
    ini = tmp_path / "config" / "mill.ini"
    ini.parent.mkdir()
    none = call("filter", part, INI_FILE_NAME=str(ini))
    assert none.stdout == b""
    wanted = "-m FILE, PH_POST_MACHINE, or ph-post.toml beside the INI file"
    got = f"no {ini.parent / 'ph-post.toml'}"
    assert one_line(none) == f"ph-post: machine: no machine file is named; expected {wanted}; got {got}"
    assert "got no INI_FILE_NAME" in one_line(call("filter", part))
    (ini.parent / "ph-post.toml").write_bytes(router.read_bytes())
    beside = call("filter", *ROOMY, part, INI_FILE_NAME=str(ini))
    named = call("filter", *ROOMY, part, PH_POST_MACHINE="router", INI_FILE_NAME=str(ini / "other.ini"))
    assert beside.returncode == named.returncode == 0
    assert beside.stdout == named.stdout
    # An option goes before the variable, the variable before the file.
    assert "no such file" in one_line(call("filter", part, PH_POST_MACHINE="no.toml", INI_FILE_NAME=str(ini)))
    asked = call("filter", "-m", "no_option.toml", part, PH_POST_MACHINE="no.toml", INI_FILE_NAME=str(ini))
    assert "no_option.toml: no such file" in one_line(asked)


def test_a_machine_file_that_is_not_beside_the_ini_file_is_named_with_its_folder(part, tmp_path):
    """Where names count from, the screen knows and its user does not."""
    found = call("filter", "-m", "mill.toml", part, cwd=tmp_path)
    assert one_line(found) == f"ph-post: {tmp_path / 'mill.toml'}: no such file"


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("bad.ngc", BAD, "bad.ngc:7:1: radii of the arc differ"),
        ("empty.ngc", "", "empty.ngc: the file is empty"),
        ("broken.json", "{", "broken.json:1:"),
        ("missing.ngc", None, "missing.ngc: no such file"),
        (".", None, "is a directory; expected a file"),
    ],
)
def test_what_cannot_be_filtered_is_one_line_and_no_program(tmp_path, name, text, said):
    place = tmp_path / name
    if text is not None:
        place.write_text(text)
    done = call("filter", "-m", "mill", "--strict", place)
    assert done.stdout == b""
    assert said in one_line(done)


# Slicers


@pytest.mark.slow
def test_a_slicer_has_its_program_edited_in_place(tmp_path):
    """A copy with another ending, as slicers hand it over; they tell the name that it will have."""
    handed, final = tmp_path / "slic3r 1.gcode.pp", tmp_path / "SD card" / "part.gcode"
    final.parent.mkdir()
    handed.write_text(CIRCLE)
    handed.chmod(0o640)
    told = {"SLIC3R_PP_HOST": "File", "SLIC3R_PP_OUTPUT_NAME": str(final), "PH_POST_MACHINE": "stepper"}
    done = run("slicer", *ROOMY, "--backup", handed, **told)
    assert done.returncode == 0
    assert done.stdout == b""
    assert done.stderr.startswith(f"{final}: ".encode())
    assert undo(handed.read_bytes(), "part") == CIRCLE.encode()
    assert handed.stat().st_mode & 0o777 == 0o640
    assert (final.parent / "part.gcode.bak").read_text() == CIRCLE
    # Sliced again, otherwise: the older backup stays. And once more: it is there already.
    for _ in range(2):
        handed.write_text(SLOT)
        assert run("slicer", *ROOMY, "--backup", handed, **told).returncode == 0
    assert (final.parent / "part.gcode.bak").read_text() == CIRCLE
    assert (final.parent / "part.gcode.bak2").read_text() == SLOT
    assert len(list(final.parent.iterdir())) == 2
    assert [one.name for one in tmp_path.iterdir() if one.is_file()] == [handed.name]


def printed(layers=3):
    """Return a hexagon as slicers write one: heated, homed, with absolute E, retracting between layers."""
    lines = [
        "; generated by a slicer",
        "M104 S210",
        "M109 S210",
        "G21",
        "G90",
        "M82",
        "G28",
        "G92 E0",
        "G1 Z0.2 F3000",
        "G1 X30 Y10 F6000",
    ]
    corners = [(20, 27.32), (0, 27.32), (-10, 10), (0, -7.32), (20, -7.32), (30, 10)]
    length = 0.0
    for layer in range(layers):
        lines += [f";LAYER:{layer}", f"G1 Z{0.2 * (layer + 1):.1f} F3000", "G1 F1200"]
        for x, y in corners:
            length += 0.66
            lines.append(f"G1 X{x} Y{y} E{length:.2f}")
        lines += [f"G1 E{length - 1.0:.2f} F2400", f"G1 E{length:.2f} F2400"]
    return "\n".join([*lines, "M107", "M104 S0", "M84", ""])


def extrusion(program):
    """Return the lengths that E words say, in their order, without repeats."""
    code = [line.partition(";")[0] for line in program.splitlines()]
    return [float(found[1]) for line in code if (found := re.search(r"E(-?[\d.]+)", line))]


@pytest.mark.parametrize("dialect", ["marlin", "klipper"])
@pytest.mark.thinned(4)
def test_a_print_keeps_its_extrusion(tmp_path, dialect):
    """Every E of the original stands in the outcome, in order; what is between lies between."""
    machine, handed = tmp_path / "printer.toml", tmp_path / "print.gcode.pp"
    shipped = (ROOT / "samples" / "machines" / "stepper.toml").read_text()
    machine.write_text(shipped.replace('dialect = "grbl"', f'dialect = "{dialect}"'))
    handed.write_text(printed())
    done = run("slicer", "-m", machine, *ROOMY, handed, SLIC3R_PP_OUTPUT_NAME="print.gcode")
    assert done.returncode == 0
    after = handed.read_text()
    if after != printed():
        assert undo(after.encode(), "print") == printed().encode()
    rest = iter(extrusion(after))
    last = 0.0
    for wanted in extrusion(printed()):
        for found in rest:
            assert min(last, wanted) <= found <= max(last, wanted)
            if found == wanted:
                break
        else:
            raise AssertionError(f"E{wanted} is missing")
        last = wanted
    assert list(rest) == []


@pytest.mark.slow
def test_for_a_print_host_the_backup_stays_on_this_machine(tmp_path):
    handed = tmp_path / "temporary.gcode"
    handed.write_text(CIRCLE)
    done = run(
        "slicer",
        "-m",
        "stepper",
        *ROOMY,
        "--backup",
        handed,
        SLIC3R_PP_HOST="OctoPrint",
        SLIC3R_PP_OUTPUT_NAME="folder/part.gcode",
    )
    assert done.returncode == 0
    assert done.stderr.startswith(b"folder/part.gcode: ")
    assert (tmp_path / "temporary.gcode.bak").read_text() == CIRCLE


@pytest.mark.parametrize(
    ("data", "options", "said"),
    [
        (BAD.encode(), ("-m", "stepper", "--strict"), "part.gcode:7:1: radii of the arc differ"),
        (b"", ("-m", "stepper"), "part.gcode: the file is empty; expected a part program"),
        (b"GCDE\x01\x00\x00\x00", ("-m", "stepper"), "part.gcode: binary G-code; expected text"),
        (CIRCLE.encode(), (), "no machine file is named; expected -m FILE, or PH_POST_MACHINE"),
        (CIRCLE.encode(), ("-m", "none.toml"), "none.toml: no such file"),
        (CIRCLE.encode(), ("-m", "stepper", "--safe-z", "5"), "--safe-z is for path files"),
        (
            CIRCLE.encode().replace(b"M2", b"#1=5"),
            ("-m", "stepper", "--strict"),
            "part.gcode:8:1: not understood",
        ),
    ],
)
def test_where_it_fails_the_original_stays_byte_for_byte(tmp_path, data, options, said):
    handed = tmp_path / "handed.gcode"
    handed.write_bytes(data)
    before = handed.stat()
    done = call("slicer", *options, "--backup", handed, SLIC3R_PP_OUTPUT_NAME="/card/part.gcode")
    assert said in one_line(done)
    assert handed.read_bytes() == data
    assert (handed.stat().st_ino, handed.stat().st_mtime_ns) == (before.st_ino, before.st_mtime_ns)
    assert [one.name for one in tmp_path.iterdir()] == ["handed.gcode"]


def test_both_have_a_name_of_their_own(monkeypatch, capsys):
    assert {"filter", "slicer"} <= set(COMMANDS)
    for entry, name in ((filter_main, "ph-post-filter"), (slicer_main, "ph-post-slicer")):
        monkeypatch.setattr(sys, "argv", [name, "--help"])
        assert entry() == 0
        assert capsys.readouterr().out.startswith(f"Usage: {name.replace('post-', 'post ')} ")


# Cura


class Script:
    """Cura's base class, as far as scripts see it."""

    def __init__(self, **values):
        self.values = values

    def getSettingValueByKey(self, key):
        return self.values.get(key)


@pytest.fixture
def cura(monkeypatch):
    """The script, loaded as Cura's plug-in loads it; and the messages that Cura has shown."""
    shown = []

    class Message:
        def __init__(self, text="", title=""):
            self.text, self.title = text, title

        def show(self):
            shown.append((self.title, self.text))

    def module(name, **holds):
        made = types.ModuleType(name)
        made.__dict__.update(holds, __path__=[])
        monkeypatch.setitem(sys.modules, name, made)

    module("UM")
    module("UM.Logger", Logger=types.SimpleNamespace(log=lambda *_words: None))
    module("UM.Message", Message=Message)
    module("PostProcessingPlugin")
    module("PostProcessingPlugin.Script", Script=Script)
    module("PostProcessingPlugin.PostProcessingPlugin")
    # Its name as Cura gives it: that is what its relative import counts on.
    name = "PostProcessingPlugin.PostProcessingPlugin.PhPost"
    spec = importlib.util.spec_from_file_location(name, ROOT / "samples" / "cura" / "PhPost.py")
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded, shown


LAYERS = [
    ";FLAVOR:Marlin\n",
    "G21 G90 G17 G94\nG0 X15 Y0\n",
    ";LAYER:0\nG1 Z0 F300\nG3 X15 Y0 I-15 J0 F400\n",
    ";LAYER:1\nG1 Z1 F300\nG3 X15 Y0 I-15 J0 F400\n",
    "G0 Z5\nM2\n",
]


@pytest.mark.slow
def test_cura_gets_the_compensated_program_in_layers(cura, tmp_path, monkeypatch):
    loaded, shown = cura
    command = executable(tmp_path / "ph-post slicer", "slicer")
    # Cura's own Python is not that of ph-post.
    monkeypatch.setenv("PYTHONHOME", "/nowhere")
    script = loaded.PhPost(executable=str(command), machine="stepper", options="--max-slowdown 1")
    found = script.execute(list(LAYERS))
    assert shown == []
    assert undo("".join(found).encode(), "cura") == "".join(LAYERS).encode()
    assert [piece.partition("\n")[0] for piece in found[1:]] == [";LAYER:0", ";LAYER:1"]
    # On its way down the axis that rests there may cross its backlash, and Z is 0.03 mm higher on its way up.
    assert all(re.search(rf"G1 ?Z{layer}(\.03)?(?!\d|\.)", piece) for layer, piece in enumerate(found[1:]))


@pytest.mark.parametrize(
    ("machine", "said"), [("none.toml", "ph-post: none.toml: no such file"), ("", "no machine file is named")]
)
@pytest.mark.thinned(2)
def test_where_it_fails_cura_keeps_its_program_and_says_why(cura, tmp_path, machine, said, monkeypatch):
    loaded, shown = cura
    monkeypatch.delenv("PH_POST_MACHINE", raising=False)
    command = executable(tmp_path / "ph-post-slicer", "slicer")
    data = list(LAYERS)
    assert loaded.PhPost(executable=str(command), machine=machine).execute(data) is data
    assert data == LAYERS
    ((title, text),) = shown
    assert title == "ph-post"
    assert said in text
    assert text.endswith("The program stays as it was.")


def test_where_the_executable_is_missing_cura_says_so(cura):
    loaded, shown = cura
    data = list(LAYERS)
    assert loaded.PhPost(executable=f"{os.sep}none{os.sep}ph-post-slicer").execute(data) is data
    assert shown[0][1].startswith("Executable: '/none/ph-post-slicer' cannot be run (No such file")
    assert "expected where ph-post-slicer is, written out in full" in shown[0][1]


def test_cura_reads_its_settings(cura):
    loaded, _ = cura
    settings = json.loads(loaded.PhPost().getSettingDataString())
    assert settings["key"] == loaded.PhPost.__name__
    assert set(settings["settings"]) == {"executable", "machine", "options"}
    assert all(set(one) == {"label", "description", "type", "default_value"} for one in settings["settings"].values())
