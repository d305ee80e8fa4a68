"""The vendor's file as it is: loads, finds its meshes, takes commands."""

import unittest
import xml.etree.ElementTree as ET
from pathlib import Path

import rospy
import test_round_trip
from support.ros_testing import SHARED, Launch

MODEL = SHARED / "data" / "unitree_g1" / "g1_29dof.urdf"


@unittest.skipUnless(MODEL.exists(), f"the vendor's {MODEL.name} is not there")
class TestVendor(test_round_trip.TestRoundTrip):
    @classmethod
    def setUpClass(cls):
        cls.launch = Launch("display.launch", "rviz:=false", f"model:={MODEL}")
        cls.addClassCleanup(cls.launch.stop)
        super().setUpClass()

    def test_its_meshes_are_absolute_and_exist(self):
        urdf = ET.fromstring(rospy.get_param("/robot_description"))
        files = [mesh.get("filename") for mesh in urdf.iter("mesh")]
        self.assertGreater(len(files), 50)
        for file in files:
            self.assertTrue(file.startswith("file:///"), file)
            self.assertTrue(Path(file[len("file://") :]).is_file(), file)
