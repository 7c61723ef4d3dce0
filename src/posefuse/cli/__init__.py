"""The command line: parse, read, call, write, say."""

import os

# The matrices are small, so threads of linear algebra mostly wait for each other, busily: reconstruct took 1.7 times
# and calibrate 3 to 5 times the CPU time on two loaded cores. NumPy reads these variables when it is first imported.
for _name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
