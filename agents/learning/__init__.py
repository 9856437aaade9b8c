"""Algorithms that learn on many scenes, and their settings."""
