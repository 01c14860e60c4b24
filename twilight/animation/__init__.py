"""Films: many pictures from one field, drawn from its tables, exposed smoothly, kept so that they can be continued."""
