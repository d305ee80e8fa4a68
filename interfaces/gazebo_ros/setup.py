"""Python package of gazebo_ros; run by catkin, not by hand."""

from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import setup

setup(**generate_distutils_setup(packages=["gazebo_ros"], package_dir={"": "src"}))
