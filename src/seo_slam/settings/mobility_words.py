"""Words for things that stay where they are and for things that people carry about: the defaults of ``AbstractionSettings``."""

STATIC_NAMES: tuple[str, ...] = (
    "table", "desk", "dining table", "coffee table", "side table", "chair", "armchair", "stool", "bench", "sofa", "bed", "crib",
    "wardrobe", "closet", "cabinet", "cupboard", "dresser", "chest of drawers", "nightstand", "bookcase", "bookshelf", "shelf", "rack",
    "counter", "kitchen island", "sideboard", "tv stand", "television", "refrigerator", "oven", "stove", "dishwasher",
    "washing machine", "sink", "bathtub", "shower", "toilet", "fireplace", "radiator", "piano", "door", "window", "curtain", "mirror",
    "stairs", "rug", "workbench", "filing cabinet", "whiteboard", "partition", "pool table", "air conditioner", "floor lamp",
    "chandelier", "wall painting",
)  # fmt: skip
"""Furniture, fixtures and appliances."""

MOVABLE_NAMES: tuple[str, ...] = (
    "cup", "mug", "teacup", "glass", "bottle", "can", "jar", "bowl", "plate", "pan", "pot", "fork", "spoon", "knife", "kettle",
    "toaster", "apple", "banana", "orange", "lemon", "strawberry", "peach", "fruit", "vegetable", "bread", "snack", "food box", "book",
    "notebook", "magazine", "newspaper", "paper", "pen", "marker", "scissors", "stapler", "tape", "tool", "hammer", "screwdriver",
    "drill", "phone", "laptop", "tablet", "keyboard", "computer mouse", "camera", "radio", "headphones", "charger", "remote control",
    "cable", "toy", "teddy bear", "doll", "toy car", "ball", "football", "tennis ball", "racquet", "game console", "puzzle", "hat",
    "helmet", "shoe", "boot", "jacket", "shirt", "towel", "blanket", "pillow", "cushion", "bag", "backpack", "handbag", "suitcase",
    "basket", "bucket", "bin", "box", "carton", "vase", "flower", "potted plant", "candle", "picture frame", "figure", "clock", "watch",
    "wallet", "keys", "glasses", "umbrella", "sponge", "soap", "toothbrush", "tissue box", "medicine", "fan", "table lamp",
)  # fmt: skip
"""What people take in their hands."""

STATIC_PHRASES: tuple[str, ...] = (
    "large furniture that is not often moved",
    "a heavy appliance built into a room",
    "a fixture of a building",
)
"""What the static names have in common, in words."""

MOVABLE_PHRASES: tuple[str, ...] = (
    "a small thing that people carry in their hands",
    "food, a drink, or a container for them",
    "a toy, a tool, a gadget or a piece of clothing",
)
"""What the movable names have in common, in words."""
