"""Words that a detector confuses, and words that it makes up."""

LOOK_ALIKES: dict[str, tuple[str, ...]] = {
    "banana": ("fruit", "toy"),
    "apple": ("fruit", "ball"),
    "book": ("notebook", "box"),
    "bag": ("backpack", "handbag", "suitcase"),
    "shoe": ("boot", "sneaker"),
    "cup": ("mug", "teacup"),
    "teacup": ("cup", "bowl"),
    "bottle": ("vase", "flask"),
    "vase": ("bottle", "pot"),
    "flower": ("plant", "vase"),
    "fan": ("electric fan", "lamp"),
    "bin": ("trash can", "bucket"),
    "snowman": ("toy", "figure"),
    "toy car": ("toy", "figure"),
    "football": ("ball", "soccer ball"),
    "scissors": ("office supply", "tool"),
    "hammer": ("tool",),
    "helmet": ("bag", "hat"),
    "monitor": ("television", "screen"),
    "racquet": ("tennis racket", "paddle"),
    "electric outlet": ("switch",),
    "Cheez-It box": ("box", "snack"),
    "bowl": ("plate", "cup"),
    "chair": ("armchair", "stool"),
}
"""Label of a thing -> labels that it is mistaken for. Chosen by hand, some are synonyms and some are wrong."""

DESK_LOOK_ALIKES: dict[str, tuple[str, ...]] = LOOK_ALIKES | {
    "keyboard": ("computer keyboard", "remote control"),
    "mouse": ("computer mouse", "stone"),
    "lamp": ("desk lamp", "fan"),
    "box": ("carton", "book"),
}
"""The same, with the things that only the simulated desk has."""

PHANTOM_LABELS = ("picture frame", "box", "cable", "shelf", "bag", "poster")
"""What a detector sees where nothing is."""
