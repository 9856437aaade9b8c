"""What the radio does: scenes, links, panels and the radio maps that they make."""
