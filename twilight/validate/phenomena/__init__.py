"""What observers of the sky have named and described, as numbers of a computed sky."""
