"""The node /gazebo, the simulator."""

from g1_description.threads import one_thread

# Before numpy is imported: results then do not depend on the number of cores, and equal
# those of the command check.
one_thread()
