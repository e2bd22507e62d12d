"""The network of real teams."""
