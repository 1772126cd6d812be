"""LeRobot data sets of version 3, read and written."""
