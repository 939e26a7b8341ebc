"""Commands of the evaluation: tables and progress."""
