"""Scores of training runs on one scene, over seeds and problems."""
