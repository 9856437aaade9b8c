"""PyTorch modules that read maps and patches."""
