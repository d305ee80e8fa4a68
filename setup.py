"""The Python side of g1_description, for catkin and for pip.

Both read package.xml, so that nothing is said twice. catkin runs this file, too:
nothing of catkin is imported here, as pip has none.
"""

import os
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

from setuptools import find_packages, setup
from setuptools.command.build_py import build_py

MANIFEST = ElementTree.parse("package.xml").getroot()

NAME = MANIFEST.findtext("name")

DATA = ("config", "meshes", "motions", "urdf", "package.xml")
"""The robot and its files, which a wheel has inside the package."""

COMMAND = "g1_description.cli.g1:main"

REQUIRES = [
    "Pillow>=10.4",
    "daqp>=0.11",
    "fast-simplification>=0.1.7; python_version >= '3.10'",
    "fast-simplification>=0.1.7,<0.1.13; python_version in '3.8 3.9'",  # has wheels
    "lxml>=4.5",
    "mcap>=1.6",
    "numpy>=1.17",
    "rosbags>=0.9.23",
    "ruamel.yaml>=0.15.89",
    "scipy>=1.3",
    "tqdm>=4.67",
    "trimesh>=3.23.5",
    "urdf_parser_py>=0.0.4",
    "xacro>=2.1.1",
]
"""Libraries from the versions on that the tests run with. requirements.txt names exact
ones, also as constraints: pip install --constraint requirements.txt."""

OLDEST = "3.8"

NOT_OLDER = f"python_version >= '{OLDEST}'"
"""With it pip of an older Python says that this is too old, not that xacro is."""

FOR_OLD_MUJOCO = [
    f"{library}; python_version < '3.11'"
    for library in (
        "etils<1.6",
        "fsspec<2025.4",
        "importlib-resources<6.5",
        "typing-extensions<4.14",
        "zipp<3.21",
    )
]
"""Without these, pip of Python 3.8 to 3.10 may try versions for minutes."""

EXTRAS = {
    "bullet": ["pybullet>=3.2.5; python_version < '3.12'"],  # newer ones are compiled
    "film": ["imageio-ffmpeg>=0.5.1"],
    "mujoco": ["mujoco>=3.2.3", *FOR_OLD_MUJOCO],
    "page": ["viser>=1.1.1", "websockets>=13.1"],
    "plot": ["matplotlib>=3.5.3"],
}
"""Libraries that are installed on request."""

EXTRAS["all"] = sorted(library for extra in EXTRAS.values() for library in extra)


def not_older(libraries):
    """Limit requirements to Pythons that this package runs on."""
    return [line if ";" in line else f"{line}; {NOT_OLDER}" for line in libraries]


BUILD = TemporaryDirectory()
"""Where pip builds. In the clone, an earlier build would be installed along with it."""


class BuildWithData(build_py):
    """Adds the data files to the package, which lie beside its sources."""

    def run(self):
        """Copy everything."""
        super().run()
        if getattr(self, "editable_mode", False):
            return  # those of the clone are found
        for name in DATA:
            copy = shutil.copytree if Path(name).is_dir() else shutil.copy
            copy(name, Path(self.build_lib, NAME, name))


def is_for_catkin():
    """Return whether catkin runs this file, which installs data and commands itself."""
    is_read = __name__ != "__main__"  # by CMake, for the names of the packages
    return is_read or "CATKIN_BINARY_DIR" in os.environ


def for_pip():
    """Return what only a wheel has."""
    return {
        "cmdclass": {"build_py": BuildWithData},
        "entry_points": {
            "console_scripts": [f"g1 = {COMMAND}", f"g1-description = {COMMAND}"]
        },
        "options": {"build": {"build_base": BUILD.name}},
    }


setup(
    name=NAME,
    version=MANIFEST.findtext("version"),
    description=" ".join(MANIFEST.findtext("description").split()),
    license=MANIFEST.findtext("license"),
    maintainer=MANIFEST.findtext("maintainer"),
    maintainer_email=MANIFEST.find("maintainer").get("email"),
    python_requires=f">={OLDEST}",
    install_requires=not_older(REQUIRES),
    extras_require={name: not_older(extra) for name, extra in EXTRAS.items()},
    packages=find_packages("src"),
    package_dir={"": "src"},
    package_data={
        "g1_description.render": ["browser/*"],
        "g1_description.web.server": ["script.js"],
    },
    **({} if is_for_catkin() else for_pip()),
)
