"""Films: many pictures drawn from the tables of one field, exposed smoothly, continued where they were interrupted."""
