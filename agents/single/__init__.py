"""Algorithms that learn on one scene, most of them of Stable-Baselines3."""
