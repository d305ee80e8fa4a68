"""Files of motions: rosbags, and all that core reads."""
