"""What the naked eye can see, and when: stars, planets and the moon on a computed sky."""
