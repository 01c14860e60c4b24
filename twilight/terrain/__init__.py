"""Mountains in front of the sky: heights, what they hide, their light and their shadows in the air."""
