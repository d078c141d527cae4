"""One colour for each contact, told apart with any kind of colour vision."""

from pydrake.geometry import Rgba

# Okabe and Ito's set (2008) without its black, in an order that keeps neighbours far apart.
_CONTACT_COLORS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#F0E442")

NO_REGION_COLOR = Rgba(0.72, 0.73, 0.75)


def contact_color(contact: int) -> Rgba:
    """Returns the colour of the contact with that index; colours come round again after seven."""
    hex_color = _CONTACT_COLORS[contact % len(_CONTACT_COLORS)]
    return Rgba(*(int(hex_color[k : k + 2], 16) / 255 for k in (1, 3, 5)))


def tint(color: Rgba, share_of_white: float) -> Rgba:
    """Returns a colour mixed with white."""
    return Rgba(
        *(share_of_white + (1 - share_of_white) * c for c in (color.r(), color.g(), color.b()))
    )


def linear_rgb(color: Rgba) -> list[float]:
    """Returns the linear RGB triple of an sRGB colour: what a recording animates."""
    return [
        c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4
        for c in (color.r(), color.g(), color.b())
    ]
