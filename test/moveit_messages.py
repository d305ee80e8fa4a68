"""Messages with the fields of MoveIt's, whose package is not needed."""

from types import SimpleNamespace as Message

ADD, REMOVE, APPEND, MOVE = range(4)


def point(x, y, z):
    return Message(x=x, y=y, z=z)


def pose(x, y, z, w=1.0):
    return Message(position=point(x, y, z), orientation=Message(x=0, y=0, z=0, w=w))


def collision_object(name, frame="world", operation=ADD, **shapes):
    empty = {
        key: []
        for kind in ("primitive", "mesh", "plane")
        for key in (kind, f"{kind}_poses")
    }
    empty["primitives"], empty["meshes"], empty["planes"] = [], [], []
    header = Message(frame_id=frame)
    at = shapes.pop("at", pose(0, 0, 0, 0))
    return Message(
        **{**empty, **shapes}, header=header, id=name, operation=operation, pose=at
    )


def primitive(kind, *dimensions):
    return Message(type=kind, dimensions=[*dimensions])


def can(**options):
    return collision_object(
        "can",
        primitives=[primitive(3, 0.12, 0.03)],
        primitive_poses=[pose(0, 0, 0.06)],
        at=pose(1, 2, 0.5),
        **options,
    )
