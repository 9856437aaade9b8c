"""What training writes and evaluation reads: run folders, pretrained models and where they come
from.
"""
