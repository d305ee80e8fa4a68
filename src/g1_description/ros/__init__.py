"""The nodes: where rospy and messages meet core and sim."""

import os

# The nodes' products are small: OpenBLAS' threads, which go on waiting for the next
# one in a loop, cost a multiple of what they compute. It reads this with numpy.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
