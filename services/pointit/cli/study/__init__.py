"""`pointit study`: run studies, and report them."""
