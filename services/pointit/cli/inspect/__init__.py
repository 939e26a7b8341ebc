"""Commands that show what a site does and what is wrong: doctor, echo, hz, topics, schema, call, audit."""
