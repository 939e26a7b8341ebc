# `pointit` is a package here too, for type checkers. Its names are in `services/pointit/__init__.pyi`.
