"""Colours of clusters: those of files (docs/results.md), and the hues of pictures."""

HUES = [
    (241, 138, 142),
    (97, 185, 222),
    (222, 199, 112),
    (207, 142, 211),
    (150, 204, 131),
    (136, 153, 230),
    (240, 166, 108),
    (100, 195, 178),
]

# Types of shapes, as in the page (web/src/shapes.ts).
TYPES = {"plane": HUES[5], "sphere": HUES[6], "cylinder": HUES[4], "cone": HUES[3]}


def of_cluster(cluster):
    """Red, green and blue of a cluster, 0 to 255."""
    strength = (100, 76, 88)[cluster // 8 % 3]
    return [(channel * strength + 50) // 100 for channel in HUES[cluster % 8]]
