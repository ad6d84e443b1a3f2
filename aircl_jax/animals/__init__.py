"""Infer what recorded animals want and avoid by likelihood: when they leave an activity, and where they go instead."""
