"""Episodes of a policy, one by one or over a whole set of scenes."""
