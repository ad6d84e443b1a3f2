"""The rows of a table: their columns checked, kept in few bytes, and equal rows found."""
