"""Floor plans that others have: grids, pictures and maps of robots, as parts of a scene."""
