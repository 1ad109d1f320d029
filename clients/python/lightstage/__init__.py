"""lightstage: a light stage from Python. Start takes, follow them, fetch their pictures, relight them.

    import lightstage
    with lightstage.connect() as stage:
        take = stage.follow(stage.start("vase", open("plan.conf").read()))
        field = stage.fetch(take.id, "W")            # float32 [light][height][width][1]
        relit = stage.relight(take.id, {"W": [0.01] * 346})
    lightstage.write_png("vase.png", relit.pixels)

`messages` are the protocol's messages as protoc makes them; answers are of these types.
"""
from . import lightstage_pb2 as messages
from .errors import Error, Lost, Number, Refused
from .factored import Factored
from .field import Field, Picture
from .pictures import write_pfm, write_png
from .relit import Relit
from .ring import Frame, Ring
from .stage import Preview, Rig, Stage, connect
from .tiles import Shared, Tiles

__all__ = ["Error", "Factored", "Field", "Frame", "Lost", "Number", "Picture", "Preview", "Refused",
           "Relit", "Rig", "Ring", "Shared", "Stage", "Tiles", "connect", "messages", "write_pfm",
           "write_png"]
