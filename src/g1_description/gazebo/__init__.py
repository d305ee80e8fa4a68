"""The node /gazebo, the simulator in place of Gazebo."""

from g1_description.threads import one_thread

# Before anything imports numpy: the same motion then falls the same way, whatever the
# number of cores, and as in the command check.
one_thread()
