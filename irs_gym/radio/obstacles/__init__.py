"""What stands in the way of robots and of lines of sight."""
