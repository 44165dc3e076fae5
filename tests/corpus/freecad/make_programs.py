"""Makes the programs in this folder with FreeCAD's own operations and posts (0.20, no screen).

Run here: ``freecadcmd make_programs.py </dev/null``. The posts write neither date nor path of the document
(``--no-header``), so that the programs are the same on every run.
"""

import pathlib
import sys

import FreeCAD
import Part
from FreeCAD import Vector
from PathScripts import (
    PathAdaptive,
    PathDeburr,
    PathDressupDogbone,
    PathDressupLeadInOut,
    PathDrilling,
    PathEngrave,
    PathHelix,
    PathJob,
    PathMillFace,
    PathPocketShape,
    PathPost,
    PathProfile,
    PathSlot,
)

HERE = pathlib.Path.cwd()
COMMON = "--no-header --no-show-editor"


def plate():
    """A plate of 60 by 40 by 10 mm: rounded corners, a pocket with an island, two bores, three holes."""
    body = Part.makeBox(60, 40, 10)
    upright = [e for e in body.Edges if abs(e.tangentAt(e.FirstParameter).z) > 0.9]
    body = body.makeFillet(6, upright)
    pocket = Part.makeBox(24, 20, 5, Vector(6, 10, 5))
    pocket = pocket.makeFillet(4, [e for e in pocket.Edges if abs(e.tangentAt(e.FirstParameter).z) > 0.9])
    pocket = pocket.cut(Part.makeCylinder(3, 5, Vector(18, 20, 5)))
    body = body.cut(pocket)
    for x, y, radius in ((40, 12, 5), (50, 28, 4)):
        body = body.cut(Part.makeCylinder(radius, 10, Vector(x, y, 0)))
    for x, y in ((36, 24), (36, 30), (42, 32)):
        body = body.cut(Part.makeCylinder(1.5, 10, Vector(x, y, 0)))
    return body.removeSplitter()


def faces(shape, test):
    return [f"Face{k}" for k, face in enumerate(shape.Faces, 1) if test(face)]


def is_floor(face):
    box = face.BoundBox
    return box.ZLength < 1e-6 and abs(box.ZMax - 5) < 1e-6


def is_top(face):
    box = face.BoundBox
    return box.ZLength < 1e-6 and abs(box.ZMax - 10) < 1e-6


def bores(shape, low, high):
    return faces(
        shape,
        lambda f: isinstance(f.Surface, Part.Cylinder) and low <= f.Surface.Radius <= high and f.BoundBox.ZLength > 9,
    )


def depths(op, step, final):
    for name, value in (("StepDown", step), ("FinalDepth", final)):
        if hasattr(op, name):
            op.setExpression(name, None)
            setattr(op, name, value)


def profile(doc, job, model):
    op = PathProfile.Create("Profile")
    depths(op, 5, 0)
    return op


def dressed(doc, job, op, module):
    """Put an operation into a dressing, as the GUI's command does."""
    doc.recompute()
    over = doc.addObject("Path::FeaturePython", "Dressing")
    proxy = module.ObjectDressup(over)
    over.Base = op
    job.Proxy.addOperation(over, op, True)
    proxy.setup(over)
    return over


def profile_with_leads(doc, job, model):
    return dressed(doc, job, profile(doc, job, model), PathDressupLeadInOut)


def pocket(doc, job, model):
    op = PathPocketShape.Create("Pocket")
    op.Base = [(model, tuple(faces(model.Shape, is_floor)))]
    op.OffsetPattern = "Offset"
    op.StepOver = 40
    depths(op, 2.5, 5)
    return op


def pocket_zigzag(doc, job, model):
    op = pocket(doc, job, model)
    op.OffsetPattern = "ZigZagOffset"
    return op


def adaptive(doc, job, model):
    op = PathAdaptive.Create("Adaptive")
    op.StepOver = 45
    op.Base = [(model, tuple(faces(model.Shape, is_floor)))]
    op.Tolerance = 0.2
    depths(op, 5, 5)
    return op


def helix(doc, job, model):
    op = PathHelix.Create("Helix")
    op.Base = [(model, tuple(bores(model.Shape, 3.5, 6)))]
    depths(op, 2, 0)
    return op


def drilling(doc, job, model):
    op = PathDrilling.Create("Drilling")
    op.Base = [(model, tuple(bores(model.Shape, 1, 2)))]
    depths(op, 5, 0)
    return op


def peck_drilling(doc, job, model):
    op = drilling(doc, job, model)
    op.PeckEnabled = True
    op.PeckDepth = 2.5
    return op


def engrave(doc, job, model):
    wave = Part.BSplineCurve()
    wave.interpolate([Vector(x, y, 10) for x, y in ((6, 4), (18, 8), (30, 3), (42, 7), (54, 4))])
    ring = Part.Circle(Vector(45, 33, 10), Vector(0, 0, 1), 3).toShape()
    line = doc.addObject("Part::Feature", "Drawing")
    line.Shape = Part.makeCompound([Part.Wire([wave.toShape()]), Part.Wire([ring])])
    doc.recompute()
    op = PathEngrave.Create("Engrave")
    op.BaseShapes = [line]
    depths(op, 0.5, 9.5)
    return op


def deburr(doc, job, model):
    op = PathDeburr.Create("Deburr")
    op.Base = [(model, tuple(faces(model.Shape, is_top)))]
    op.Width = 0.5
    return op


def facing(doc, job, model):
    op = PathMillFace.Create("Face")
    op.Base = [(model, tuple(faces(model.Shape, is_top)))]
    op.OffsetPattern = "ZigZag"
    depths(op, 1, 10)
    return op


def slot(doc, job, model):
    op = PathSlot.Create("Slot")
    op.CustomPoint1, op.CustomPoint2 = Vector(32, 2, 10), Vector(58, 20, 10)
    depths(op, 1, 8)
    return op


def dogbone(doc, job, model):
    """Corners of a square frame, which a round tool leaves; the frame is profiled inside."""
    op = PathProfile.Create("Profile")
    op.Side = "Inside"
    op.UseComp = True
    depths(op, 5, 0)
    doc.recompute()
    return PathDressupDogbone.Create(op)


JOBS = (
    (profile, 3, ("linuxcnc", "grbl")),
    (profile_with_leads, 3, ("linuxcnc",)),
    (pocket, 3, ("linuxcnc", "grbl")),
    (pocket_zigzag, 3, ("linuxcnc",)),
    (adaptive, 3, ("linuxcnc",)),
    (helix, 3, ("linuxcnc", "grbl")),
    (drilling, 3, ("linuxcnc", "grbl")),
    (peck_drilling, 3, ("linuxcnc",)),
    (engrave, 1, ("linuxcnc", "grbl")),
    (deburr, 4, ("linuxcnc",)),
    (facing, 6, ("linuxcnc",)),
    (slot, 3, ("linuxcnc", "grbl")),
    (dogbone, 3, ("linuxcnc",)),
)


def make(kind, diameter, posts):
    """Make one job with one operation, and post it."""
    doc = FreeCAD.newDocument("part")
    part = doc.addObject("Part::Feature", "Plate")
    part.Shape = plate()
    doc.recompute()
    job = PathJob.Create("Job", [part])
    model = job.Model.Group[0]
    controller = job.Tools.Group[0]
    controller.HorizFeed, controller.VertFeed, controller.SpindleSpeed = "600 mm/min", "120 mm/min", 8000
    if hasattr(controller.Tool, "Diameter"):
        controller.Tool.Diameter = diameter
    doc.recompute()
    op = kind(doc, job, model)
    if hasattr(op, "ToolController"):
        op.ToolController = controller
    doc.recompute()
    for post in posts:
        name = f"{kind.__name__}_{post}.ngc"
        job.PostProcessor = post
        job.PostProcessorArgs = COMMON
        job.PostProcessorOutputFile = str(HERE / name)
        command = PathPost.CommandPathPost()
        for sub in command.buildPostList(job):
            failed, _, _ = command.exportObjectsWith(sub, job)
            # The post for grbl writes the file and returns nothing.
            outcome = "failed" if failed else "written"
            sys.stdout.write(f"{name}: {outcome}, {len(op.Path.Commands)} commands\n")
    FreeCAD.closeDocument(doc.Name)


for job in JOBS:
    make(*job)
