"""What the workflow saw and commanded: the log of a run, and its replay."""
