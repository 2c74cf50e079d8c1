"""What a robot is: the schema, the loader that says what is wrong and where, the shipped files."""
