"""The browser view: what is shown, and what a person does with it; no ROS."""
