"""Policies for the environment: reference rules, configured learners, and the run folders that hold them."""
