"""A job in the real FreeCAD without a screen, posted several times; run by freecadcmd.

PH_JOB_POSTS: a JSON list of [post-processor, arguments, output file]; PH_JOB_FOLDER: where ours is. What came
of each, and places on the engraved spline [mm], go to PH_JOB_REPORT in JSON.
"""

import json
import os
from pathlib import Path as FilePath

import FreeCAD
import Part

FreeCAD.ParamGet("User parameter:BaseApp/Preferences/Macro").SetString("MacroPath", os.environ["PH_JOB_FOLDER"])

from PathScripts import (  # noqa: E402 - the folder of the post-processors has to be known
    PathDrilling,
    PathEngrave,
    PathJob,
    PathPost,
    PathProfile,
    PathToolController,
)

V = FreeCAD.Vector


def at_depths(operation, controller, start, depth, step):
    operation.ToolController = controller
    for name, value in (("StepDown", step), ("StartDepth", start), ("FinalDepth", depth)):
        if hasattr(operation, name):  # a drilling has no steps
            operation.setExpression(name, None)
            setattr(operation, name, value)


def make_job(document):
    """Outline of a disc (arcs), a spline engraved into it, and two holes with another tool and coolant."""
    disc = document.addObject("Part::Cylinder", "Disc")
    disc.Radius, disc.Height = 20, 5
    spline = Part.BSplineCurve()
    spline.interpolate([V(-12, 0, 5), V(-4, 7, 5), V(5, -6, 5), V(12, 1, 5)])
    drawn = document.addObject("Part::Feature", "Drawn")
    drawn.Shape = Part.Wire([spline.toShape()])
    document.recompute()
    job = PathJob.Create("Job", [disc, drawn])
    mill = job.Tools.Group[0]
    mill.HorizFeed, mill.VertFeed, mill.SpindleSpeed = "600 mm/min", "120 mm/min", 8000
    outline = PathProfile.Create("Outline")
    outline.Base = [(job.Model.Group[0], ["Face3"])]
    at_depths(outline, mill, 5.0, 0.0, 5.0)
    engraving = PathEngrave.Create("Engraving")
    engraving.BaseShapes = [job.Model.Group[1]]
    at_depths(engraving, mill, 5.0, 4.5, 1.0)
    holes = PathDrilling.Create("Holes")
    # without a screen FreeCAD cannot ask which of two tools an operation is to have
    drill = PathToolController.Create("TC: drill", None, 2)
    drill.VertFeed, drill.SpindleSpeed = "90 mm/min", 3000
    job.Proxy.addToolController(drill)
    holes.Locations = [V(-8, -8, 0), V(8, -8, 0)]
    holes.CoolantMode = "Flood"
    at_depths(holes, drill, 5.0, 1.0, 1.0)
    job.Fixtures = ["G55"]
    document.recompute()
    return job, [[p.x, p.y] for p in drawn.Shape.Edges[0].discretize(Number=200)]


def post(job, name, arguments, output):
    """Post as the button does; what is raised is what the report view shows."""
    job.PostProcessor, job.PostProcessorArgs, job.PostProcessorOutputFile = name, arguments, output
    command = PathPost.CommandPathPost()
    try:
        for part in command.buildPostList(job):
            command.exportObjectsWith(part, job)
    except Exception as error:
        return str(error)
    return ""


job, places = make_job(FreeCAD.newDocument("part"))
said = [post(job, *one) for one in json.loads(os.environ["PH_JOB_POSTS"])]
FilePath(os.environ["PH_JOB_REPORT"]).write_text(json.dumps({"said": said, "spline": places}), encoding="utf-8")
