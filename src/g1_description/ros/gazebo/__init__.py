"""The stand-in's node /gazebo."""

from g1_description.sim.batch.threads import one_thread

# Before anything imports numpy: the same motion then falls the same way, whatever the
# number of cores, and as in the command check.
one_thread()
