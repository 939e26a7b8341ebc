"""Foreign worlds: pages in browsers, viewers; each folder is a process of its own, like a service."""

if __name__ != "pointit.bridges":
    raise ImportError("this is `pointit.bridges`; import it by that name")
