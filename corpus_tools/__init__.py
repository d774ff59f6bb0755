"""What people run: the command line and the work behind it."""
