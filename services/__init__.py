"""Services that make the decisions. Each has its own folder and process."""

if __name__ != "pointit.services":
    raise ImportError("this is `pointit.services`; import it by that name")
