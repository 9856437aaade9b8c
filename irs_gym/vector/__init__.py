"""The rules for many robots at once, over one scene or many."""
