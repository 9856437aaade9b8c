"""Which scenes there are: generated ones, their splits, and sets of them with their maps."""
