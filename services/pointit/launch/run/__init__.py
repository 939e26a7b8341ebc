"""The services that run now: started, watched, announced to the site and scored."""
