"""The option --person: position of a person in the room."""

import math

import click

Point = tuple[float, float]


def point(ctx: click.Context, parameter: click.Parameter, text: str | None) -> Point | None:
    """Return the two numbers in `text`.

    Raises:
        click.BadParameter: If it does not have two.
    """
    if text is None:
        return None
    try:
        x, y = (float(word) for word in text.split(","))
    except ValueError:
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        raise click.BadParameter(
            f"{text!r} is not a position; write x and y in metres, such as 1.5,-2", ctx=ctx, param=parameter
        )
    return x, y


person_option = click.option(
    "--person",
    "person_m",
    metavar="X,Y",
    callback=point,
    help="position of a person in the room, m; write --person=-1,2 if x is negative",
)
