"""From a result to controller files, and back."""
