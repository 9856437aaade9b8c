"""Walls, racks and doors, drawn at random in a room."""
