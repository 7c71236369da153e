"""Zenoh key expressions: `*` stands for one segment, `**` for any number of them."""

__all__ = ["expressions_intersect", "key_matches"]


def key_matches(expression: str, key: str) -> bool:
    """Match `key`, which has no wildcard, against a key expression."""
    return expressions_intersect(expression, key)


def expressions_intersect(left: str, right: str) -> bool:
    """Return whether some key matches both key expressions."""
    return _segments_intersect(left.split("/"), right.split("/"))


def _segments_intersect(left: list[str], right: list[str]) -> bool:
    if left[:1] == ["**"]:
        return any(_segments_intersect(left[1:], right[i:]) for i in range(len(right) + 1))
    if right[:1] == ["**"]:
        return _segments_intersect(right, left)
    if not left or not right:
        return left == right
    same = left[0] == right[0] or "*" in (left[0], right[0])
    return same and _segments_intersect(left[1:], right[1:])
