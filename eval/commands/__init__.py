"""The commands of `python -m eval`, each the function `main` of its module."""
