"""Robots and models that mean harm, each by a name that says how."""

import os
import struct

INERTIAL = (
    '<inertial><mass value="{0}"/><inertia ixx="{1}" iyy="{1}" izz="{1}" '
    'ixy="0" ixz="0" iyz="0"/></inertial>'
)
SOLID = INERTIAL.format(1, 0.1)
BOX = '<collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision>'
LIMIT = '<limit lower="-1" upper="1" effort="10" velocity="10"/>'
SDF_BOX = (
    '<link name="{}"><inertial><mass>1</mass></inertial><collision name="c"><geometry>'
    "<box><size>.2 .2 .2</size></box></geometry></collision></link>"
)
SECRET = "root:"
"""What stands in /etc/passwd and must stand in no answer."""


ON_THE_ROBOT = ("random.stl", "zero.stl", "bomb.dae", "folder.stl", "memory.stl")
"""Broken meshes that a robot has, too: test_mesh_files.py reads them all."""


def robot(content, name="r"):
    return f'<robot name="{name}">{content}</robot>'


def link(name="only", content=SOLID + BOX):
    return f'<link name="{name}">{content}</link>'


def joint(number, parent, child, kind="revolute"):
    return (
        f'<joint name="j{number}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="0 1 0"/>{LIMIT}</joint>'
    )


def chain(count, kind="revolute"):
    """Give a robot of links in a row."""
    links = (link(f"l{n}", SOLID) for n in range(count))
    joints = (joint(n, f"l{n}", f"l{n + 1}", kind) for n in range(count - 1))
    return robot("".join([*links, *joints]))


def mesh(uri, scale="1 1 1"):
    """Give a robot with one mesh."""
    shape = f'<geometry><mesh filename="{uri}" scale="{scale}"/></geometry>'
    return robot(link(content=f"{SOLID}<collision>{shape}</collision>"))


def sdf(content):
    return f'<sdf version="1.7">{content}</sdf>'


def sdf_model(content, name="m"):
    return sdf(f'<model name="{name}">{content}</model>')


def entities(count, times):
    """Give a document whose entities unfold to times**count letters."""
    lines = ['<!ENTITY e0 "ha">']
    lines += [f'<!ENTITY e{n} "{f"&e{n - 1};" * times}">' for n in range(1, count)]
    return f"<!DOCTYPE robot [{''.join(lines)}]>{robot(f'&e{count - 1};')}"


def nested(count):
    inner = f'<model name="deepest">{SDF_BOX.format("l")}</model>'
    for n in range(count):
        inner = f'<model name="n{n}">{inner}</model>'
    return sdf(inner)


def numbers(mass, inertia):
    return robot(link(content=INERTIAL.format(mass, inertia) + BOX))


def broken_meshes(folder):
    """Write files that are no meshes; give their URIs."""
    noise = bytes(range(256)) * 40
    triangles = struct.pack("<I", 2**32 - 1)
    files = {
        "random.stl": noise,
        "random.obj": noise,
        "random.dae": noise,
        "empty.stl": b"",
        "empty.obj": b"",
        "empty.dae": b"",
        "header.stl": b"\0" * 80 + triangles,
        "many.stl": b"\0" * 80 + struct.pack("<I", 85899345) + b"\0" * 1000,
        "half.stl": b"\0" * 80 + struct.pack("<I", 100) + b"\0" * 333,
        "zero.stl": b"\0" * 80 + struct.pack("<I", 0),
        "nan.stl": b"\0" * 80 + struct.pack("<I", 2) + b"\xff" * 100,
        "flat.stl": b"\0" * 80 + struct.pack("<I", 2) + b"\0" * 100,
        "index.obj": b"v 0 0 0\nf 1 2 3\nf 999999999 -5 0\n",
        "huge.obj": b"v 1e300 1e300 nan\nv inf 0 0\nv 0 1 0\nf 1 2 3\n",
        "line.obj": b"v " + b"1" * 100000 + b"\n",
        "bomb.dae": entities(9, 10).encode(),
        "half.dae": b'<?xml version="1.0"?><COLLADA><library_geometries><geometry>',
        "hollow.dae": b'<COLLADA version="1.4.1"><library_geometries><geometry id="g">'
        b'<mesh><source id="s"><float_array count="9">1 2</float_array></source>'
        b"<triangles count='4000000000'><p>9 9 9</p></triangles></mesh></geometry>"
        b"</library_geometries></COLLADA>",
    }
    for name, content in files.items():
        (folder / name).write_bytes(content)
    (folder / "folder.stl").mkdir()
    (folder / "memory.stl").symlink_to("/proc/self/mem")
    (folder / "loop.stl").symlink_to("loop.stl")
    names = [*files, "folder.stl", "memory.stl", "loop.stl"]
    return {name: f"file://{folder}/{name}" for name in names}


def urdf_attacks(folder):
    """List robots by the name of what is wrong with them."""
    broken = broken_meshes(folder)
    os.mkfifo(f"{folder}/pipe.stl")
    uris = {
        **{name: broken[name] for name in ON_THE_ROBOT},
        **{
            uri: uri
            for uri in (
                f"{folder}/pipe.stl",
                "/etc/passwd",
                "file:///etc/passwd",
                "/",
                "/tmp",
                "/dev/zero",
                "/dev/stdin",
                "/proc/self/mem",
                "/proc/kmsg",
                "package://../../../../etc/passwd",
                "package://g1_description/../../../../../etc/passwd",
                "package://",
                "model://../../etc/passwd",
                "http://localhost:1/a.stl",
                "file://%00.stl",
                "file:///tmp/%ff.stl",
                "a" * 5000 + ".stl",
                "/" + "a/" * 3000 + "a.stl",
                "",
            )
        },
    }
    external = '<!DOCTYPE robot [<!ENTITY e SYSTEM "file:///etc/passwd">]>'
    parameter = '<!DOCTYPE robot [<!ENTITY % e SYSTEM "file:///etc/passwd"> %e;]>'
    include = '<x xmlns:xi="http://www.w3.org/2001/XInclude">{}</x>'.format(
        '<xi:include href="file:///etc/passwd" parse="text"/>'
    )
    names = {
        "slash": "a/b",
        "quotes": "&quot;" * 3 + "'",
        "many quotes": "&quot;" * 900,
        "less": "&lt;x&gt;&lt;/x&gt;",
        "between": "&gt;&lt;",
        "newline": "a&#10;b",
        "tab": "a&#9;b",
        "spaces": "  a   b  ",
        "empty": "",
        "scope": "a::b",
        "long": "n" * 2000,
        "longest": "n" * 1000,
        "wide": "\u00e4\u4e2d\U0001f916" * 100,
        "percent": "%s%n%d",
        "million": "n" * 1_000_000,
    }
    ends = (link("a"), link("b"))
    attacks = {
        "billion laughs": entities(10, 10),
        "quadratic blowup": f'<!DOCTYPE r [<!ENTITY a "{"a" * 100000}">]>'
        + robot("&a;" * 10000),
        "external entity": external + robot("&e;"),
        "external entity in a name": external + robot(link("&e;")),
        "parameter entity": parameter + robot(link()),
        "xinclude": robot(link() + include),
        "doctype": "<!DOCTYPE robot>" + robot(link()),
        "undeclared entity": robot("&nowhere;"),
        "stylesheet": '<?xml-stylesheet href="file:///etc/passwd"?>' + robot(link()),
        "unclosed comment": "<!-- " + robot(link()),
        "comment in the middle": robot(f"{link()}<!-- "),
        "unclosed cdata": robot("<![CDATA["),
        "100 000 deep": "<robot>" * 100_000,
        "100 000 deep and closed": "<a>" * 100_000 + "</a>" * 100_000,
        "200 deep": robot("<a>" * 200 + "</a>" * 200 + link()),
        "200 deep in a link": robot(link(content="<visual>" * 200 + "</visual>" * 200)),
        "20 000 attributes": "<robot " + " ".join(f'a{n}="1"' for n in range(20_000)),
        "attribute of 20 MB": robot(link(), name="n" * 20_000_000),
        "utf-16 declared": '<?xml version="1.0" encoding="utf-16"?>' + robot(link()),
        "nul": robot(link("a\0b")),
        "surrogate": robot(link("a\ud800b")),
        "byte order mark": "\ufeff" + robot(link()),
        "1500 revolute": chain(1500),
        "1500 fixed": chain(1500, "fixed"),
        "1500 loose": robot("".join(link(f"l{n}", SOLID) for n in range(1500))),
        "1500 empty": robot("".join(link(f"l{n}", "") for n in range(1500))),
        "999 revolute": chain(999),
        "127 revolute": chain(128),
        "2000 collisions": robot(link(content=SOLID + BOX * 2000)),
        "10 000 materials": robot(
            "".join(f'<material name="m{n}"/>' for n in range(10_000)) + link()
        ),
        "two roots": robot("".join(ends)),
        "loop": robot("".join(ends) + joint(1, "a", "b") + joint(2, "b", "a")),
        "itself": robot(ends[0] + joint(1, "a", "a")),
        "same link twice": robot(link() + link()),
        "no such parent": robot(ends[0] + joint(1, "nobody", "a")),
        "joint without ends": robot(ends[0] + '<joint name="j" type="fixed"/>'),
        "joint without type": robot(ends[0] + '<joint name="j"/>'),
        "joint of no kind": robot("".join(ends) + joint(1, "a", "b", "nonsense")),
        "link without name": robot(f"<link>{SOLID}</link>"),
        "robot without name": f"<robot>{link()}</robot>",
        "no axis": robot("".join(ends) + joint(1, "a", "b").replace("0 1 0", "0 0 0")),
        "axis of NaN": robot(
            "".join(ends) + joint(1, "a", "b").replace("0 1 0", "nan 0 0")
        ),
        "axis of one": robot("".join(ends) + joint(1, "a", "b").replace("0 1 0", "1")),
        "tiny axis": robot(
            "".join(ends) + joint(1, "a", "b").replace("0 1 0", "1e-320 0 0")
        ),
        "huge axis": robot(
            "".join(ends) + joint(1, "a", "b").replace("0 1 0", "1e300 1e300 1e300")
        ),
        "limits of NaN": robot(
            "".join(ends) + joint(1, "a", "b").replace('lower="-1"', 'lower="nan"')
        ),
        "limits of 1e300": robot(
            "".join(ends) + joint(1, "a", "b").replace('upper="1"', 'upper="1e300"')
        ),
        "damping of NaN": robot(
            "".join(ends)
            + joint(1, "a", "b").replace(
                "</joint>", '<dynamics damping="nan"/></joint>'
            )
        ),
        "damping of -1e300": robot(
            "".join(ends)
            + joint(1, "a", "b").replace(
                "</joint>", '<dynamics damping="-1e300" friction="1e300"/></joint>'
            )
        ),
        "damping of a word": robot(
            "".join(ends)
            + joint(1, "a", "b").replace("</joint>", '<dynamics damping="x"/></joint>')
        ),
        "mimics nobody": robot(
            "".join(ends)
            + joint(1, "a", "b").replace("</joint>", '<mimic joint="nobody"/></joint>')
        ),
        "origin of words": robot(
            link(content='<visual><origin xyz="a b c"/></visual>')
        ),
        "origin of two": robot(
            link(content=BOX.replace("<geo", '<origin xyz="1 2"/><geo'))
        ),
        "box of nothing": robot(
            link(content=SOLID + BOX.replace('size="0.2 0.2 0.2"', ""))
        ),
        "box of zero": robot(link(content=SOLID + BOX.replace("0.2", "0"))),
        "box of 1e9": robot(link(content=SOLID + BOX.replace("0.2", "1e9"))),
        "box of 1e-320": robot(link(content=SOLID + BOX.replace("0.2", "1e-320"))),
        "collision of nothing": robot(link(content=SOLID + "<collision/>")),
        "geometry of nothing": robot(
            link(content=SOLID + "<collision><geometry/></collision>")
        ),
        "cylinder without length": robot(
            link(
                content=SOLID
                + '<collision><geometry><cylinder radius="1"/></geometry></collision>'
            )
        ),
        "inertial without mass": robot(link(content="<inertial/>" + BOX)),
        "inertia of one number": robot(
            link(content='<inertial><mass value="1"/><inertia ixx="1"/></inertial>')
        ),
        **{
            f"mass {mass}": numbers(mass, "0.1")
            for mass in ("1e300", "1e9", "1e-300", "0", "-1", "nan", "inf", "x", "")
        },
        **{
            f"inertia {inertia}": numbers("1", inertia)
            for inertia in ("0", "-1", "1e300", "1e-300", "nan", "1e9")
        },
        **{f"a link called {kind}": robot(link(n)) for kind, n in names.items()},
        **{
            f"a robot called {kind}": robot(link(), names[kind])
            for kind in ("empty", "quotes", "million")
        },
        **{
            f"a joint called {kind}": robot(
                "".join(ends) + joint(1, "a", "b").replace('"j1"', f'"{names[kind]}"')
            )
            for kind in ("empty", "scope", "million")
        },
        **{f"mesh {name[:60]}": mesh(uri) for name, uri in uris.items()},
        **{
            f"mesh scaled {scale}": mesh(uris["zero.stl"], scale)
            for scale in ("0 0 0", "nan nan nan", "1e300 1 1", "-1 -1 -1", "1")
        },
        "text": "this is not xml",
        "nothing": "",
        "blanks": " " * 100_000,
        "brackets": "<" * 1_000_000,
        "html": "<html><body/></html>",
    }
    return attacks


def sdf_attacks(folder):
    """List SDF documents by the name of what is wrong with them."""
    uris = {name: f"file://{folder}/{name}" for name in ("random.stl", "header.stl")}
    uris.update((uri, uri) for uri in ("/etc/passwd", "/dev/zero", "/", "file:///"))
    uris.update(
        (uri, uri) for uri in ("model://../../etc/passwd", "model://", "x:" * 9)
    )
    shape = (
        '<link name="l"><inertial><mass>1</mass></inertial><collision name="c">'
        "<geometry>{}</geometry></collision></link>"
    )
    box = SDF_BOX.format("l")
    external = '<!DOCTYPE sdf [<!ENTITY e SYSTEM "file:///etc/passwd">]>'
    return {
        "empty": "<sdf/>",
        "no version": "<sdf><model name='m'/></sdf>",
        "version of words": "<sdf version='x'><model name='m'/></sdf>",
        "no content": sdf(""),
        "empty model": sdf_model(""),
        "model without name": sdf(f"<model>{box}</model>"),
        "link without name": sdf_model("<link/>"),
        "billion laughs": entities(10, 10),
        "external entity": external + sdf_model("&e;"),
        "unclosed comment": "<!-- " + sdf_model(box),
        "100 nested models": nested(100),
        "250 nested models": nested(250),
        "10 000 nested models": nested(10_000),
        "1500 links": sdf_model("".join(SDF_BOX.format(f"l{n}") for n in range(1500))),
        "1500 static links": sdf_model(
            "<static>1</static>" + "".join(SDF_BOX.format(f"l{n}") for n in range(1500))
        ),
        "900 static links": sdf_model(
            "<static>1</static>" + "".join(SDF_BOX.format(f"l{n}") for n in range(900))
        ),
        "two models": sdf(
            f'<model name="a">{box}</model><model name="b">{box}</model>'
        ),
        "world": sdf(f'<world name="w"><model name="a">{box}</model></world>'),
        "frames in a ring": sdf_model(
            box + '<frame name="a" attached_to="b"/><frame name="b" attached_to="a"/>'
        ),
        "pose in a ring": sdf_model(
            '<link name="a"><pose relative_to="b"/></link>'
            '<link name="b"><pose relative_to="a"/></link>'
        ),
        "5000 frames in a row": sdf_model(
            box
            + '<frame name="f0"/>'
            + "".join(
                f'<frame name="f{n}" attached_to="f{n - 1}"/>' for n in range(1, 5000)
            )
        ),
        "pose of NaN": sdf_model(f"<pose>nan 0 0 0 0 0</pose>{box}"),
        "pose of 1e300": sdf_model(f"<pose>1e300 0 0 0 0 0</pose>{box}"),
        "pose of words": sdf_model(f"<pose>a b c d e f</pose>{box}"),
        "mass 0": sdf_model(box.replace("<mass>1", "<mass>0")),
        "mass -1": sdf_model(box.replace("<mass>1", "<mass>-1")),
        "mass 1e300": sdf_model(box.replace("<mass>1", "<mass>1e300")),
        "mass nan": sdf_model(box.replace("<mass>1", "<mass>nan")),
        "mass of nothing": sdf_model(box.replace("<mass>1", "<mass>")),
        "friction of NaN": sdf_model(
            box.replace(
                "</geometry>",
                "</geometry><surface><friction><ode><mu>nan</mu></ode></friction>"
                "</surface>",
            )
        ),
        "plane of zero": sdf_model(
            shape.format("<plane><normal>0 0 0</normal></plane>")
        ),
        "unknown shape": sdf_model(shape.format("<heightmap/>")),
        "includes itself": sdf("<include><uri>model://fuzz_itself</uri></include>"),
        "includes what is not there": sdf(
            "<include><uri>model://nowhere</uri></include>"
        ),
        "merges": sdf('<include merge="1"><uri>model://sun</uri></include>'),
        **{
            f"includes {name}": sdf(f"<include><uri>{uri}</uri></include>")
            for name, uri in uris.items()
        },
        **{
            f"mesh {name}": sdf_model(
                shape.format(f"<mesh><uri>{uri}</uri><scale>1 1 1</scale></mesh>")
            )
            for name, uri in uris.items()
        },
        "mesh scaled by NaN": sdf_model(
            shape.format("<mesh><uri>/a.stl</uri><scale>nan 0 0</scale></mesh>")
        ),
        "light": sdf('<light name="l" type="nonsense"><diffuse>x</diffuse></light>'),
        "light of NaN": sdf('<light name="l"><diffuse>nan 0 0 1</diffuse></light>'),
        "joint to itself": sdf_model(
            box + '<joint name="j" type="revolute"><parent>l</parent><child>l</child>'
            "<axis><xyz>0 0 1</xyz></axis></joint>"
        ),
        "joint of no kind": sdf_model(
            box + '<joint name="j" type="x"><parent>world</parent><child>l</child>'
            "</joint>"
        ),
        "axis of zero": sdf_model(
            box
            + '<joint name="j" type="revolute"><parent>world</parent><child>l</child>'
            "<axis><xyz>0 0 0</xyz></axis></joint>"
        ),
    }
