"""What a temperature step is judged by, one file per metric."""
