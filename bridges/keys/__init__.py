"""Certificates of guarded teams."""
