"""Commands for people: check, pose, snapshot and others."""

from g1_description.sim.batch.threads import one_thread

# Before anything imports numpy, which reads this once. The arrays are small: threads
# would spend their time waiting for each other.
one_thread()
