"""Header of a PCD, the point clouds of PCL, whose points are text."""

from collections.abc import Sequence

from pointit.runtime.config.validation_message import format_value
from pointit.runtime.errors import ConfigError


def read_pcd_header(sample: Sequence[str]) -> tuple[int, list[str]] | None:
    """Return the number of lines before the points and the names of the columns, None if it is no PCD.

    Args:
        sample: first lines of the file.

    Raises:
        ConfigError: If the points are binary, or the header is not understood. Does not name the file.
    """
    lines: dict[str, list[str]] = {}
    for number, line in enumerate(sample, start=1):
        word, *values = line.split() or [""]
        lines[word.upper()] = values
        if word.upper() != "DATA" or not {"FIELDS", "COLUMNS"} & lines.keys():
            continue
        if [value.lower() for value in values] != ["ascii"]:
            raise ConfigError(
                f"is a PCD with the points {format_value(' '.join(values))}; save it with ascii points, as "
                "`pcl_convert_pcd_ascii_binary FILE OUT 0` does, or as PLY"
            )
        fields = lines.get("FIELDS") or lines.get("COLUMNS") or []
        counts = lines.get("COUNT") or ["1"] * len(fields)
        if len(counts) != len(fields) or not all(map(str.isdecimal, counts)):
            raise ConfigError(
                f"is a PCD with {len(fields)} FIELDS and COUNT {format_value(' '.join(counts))}; "
                "export it again"
            )
        return number, [name for name, count in zip(fields, counts, strict=True) for _ in range(int(count))]
    return None
