"""Commands that show a site's activity and problems: doctor, echo, hz, topics, schema, call, audit."""
