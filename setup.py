"""The Python side of g1_description, for catkin and for pip.

Both read package.xml and requirements.txt, so that nothing is said twice. catkin runs
this file, too: nothing of catkin is imported here, as pip has none.
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

from setuptools import find_packages, setup

SHARE = Path("share", "g1_description")
"""Where the robot and its files lie below the prefix, as catkin installs them."""

EXTRAS = {"mujoco": ("mujoco", "etils", "fsspec", "importlib-resources", "zipp")}
"""Libraries that are installed on request: pip install .[mujoco]."""

ROS_ONLY = {"python3-rospkg", "python3-setuptools"}
"""Packages of package.xml that are of no use without ROS."""

BUILD = TemporaryDirectory()
"""Where pip builds. In the clone, an earlier build would be installed along with it."""

MANIFEST = ElementTree.parse("package.xml").getroot()


LINES = Path("requirements.txt").read_text(encoding="utf-8").splitlines()
PINNED = [line.partition("#")[0].strip() for line in LINES]


def extras(names):
    """List the pinned ones of some libraries."""
    return [pin for pin in PINNED if pin.partition("==")[0] in names]


def requirements():
    """List what is imported: from PyPI in any case, and what ROS' machines have."""
    optional = {pin for names in EXTRAS.values() for pin in extras(names)}
    pinned = [pin for pin in PINNED if pin not in optional]
    others = {element.text for element in MANIFEST.findall("exec_depend")} - ROS_ONLY
    prefix = "python3-"  # the names behind it are those of PyPI
    free = sorted(name[len(prefix) :] for name in others if name.startswith(prefix))
    return [*filter(None, pinned), *free]


def data_files():
    """List files by the folder that they are installed in."""
    folders = ("config", "meshes", "motions", "urdf")
    below = [path for name in folders for path in sorted(Path(name).rglob("*"))]
    files = [Path("package.xml"), *(path for path in below if path.is_file())]
    return [(str(SHARE / path.parent), [str(path)]) for path in files]


setup(
    name=MANIFEST.findtext("name"),
    version=MANIFEST.findtext("version"),
    description=" ".join(MANIFEST.findtext("description").split()),
    license=MANIFEST.findtext("license"),
    maintainer=MANIFEST.findtext("maintainer"),
    maintainer_email=MANIFEST.find("maintainer").get("email"),
    python_requires=">=3.8",
    install_requires=requirements(),
    extras_require={extra: extras(names) for extra, names in EXTRAS.items()},
    packages=find_packages("src"),
    package_dir={"": "src"},
    package_data={
        "g1_description.render": ["browser/*"],
        "g1_description.web.server": ["script.js"],
    },
    data_files=data_files(),
    options={"build": {"build_base": BUILD.name}},
)
