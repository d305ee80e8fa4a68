"""Python packages of g1_description; run by catkin, not by hand."""

from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import setup

setup(
    **generate_distutils_setup(
        packages=[
            "g1_description",
            "g1_description.core",
            "g1_description.importer",
            "g1_description.ros",
            "g1_description.sim",
        ],
        package_dir={"": "src"},
    )
)
