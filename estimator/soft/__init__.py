"""Labelled target mixtures that people's soft observations can change."""
