"""The running services: started, watched, announced to the site and scored."""
