"""One bag per temperature step: write, read, recover."""
