"""The feature of each observation: picture and word in one vector (DualMap III-A2, Eq 1)."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seo_slam.errors import ConfigError, FrameError
from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Embedder
from seo_slam.records import FeatureRecipe
from seo_slam.settings.observing import FeatureSettings
from seo_slam.types import BoolArray, Frame


class ObservationFeatures:
    """Makes features of one run; it remembers which words were said, and what it has warned of."""

    def __init__(self, settings: FeatureSettings, embedder: Embedder, image_encoder: Any = None) -> None:
        """Choose who looks at pictures.

        Args:
            settings: the weights of Eq 1, and what stands for the word where there is none.
            embedder: of words; of pictures too, if it is an ``ImageEmbedder`` or ``CropEmbedder`` and no ``image_encoder`` is given.
            image_encoder: an ``ImageEmbedder`` or a ``CropEmbedder`` in the space of the words.

        Raises:
            ConfigError: both weights are 0, or the image encoder is none.
        """
        if settings.image_weight == 0 and settings.text_weight == 0:
            raise ConfigError("features: image_weight and text_weight are both 0, wanted one of them above 0")
        if image_encoder is not None and not sees(image_encoder):
            raise ConfigError(
                f"features: image_encoder is a {type(image_encoder).__name__}, wanted something with embed_image or embed_crops"
            )
        self._settings = settings
        self._embedder = embedder
        self._encoder: Any = image_encoder if image_encoder is not None else embedder if sees(embedder) else None
        self._words: dict[str, None] = dict.fromkeys(settings.classes)
        self._null: FloatArray | None = None
        self._warned: set[str] = set()
        self._looker = _name_of(self._encoder) if self._encoder is not None and settings.image_weight > 0 else ""

    def of(
        self, frame: Frame, boxes_px: FloatArray, labels: Sequence[str | None], own: FloatArray | None = None
    ) -> tuple[FloatArray, tuple[str, ...]]:
        """Return the features of what is in some boxes of a frame, and warnings in words.

        Args:
            frame: the image.
            boxes_px: (K, 4) in pixels.
            labels: K words, or None.
            own: (K, D) the detector's own embeddings of the pictures; a row of zeros is none. With them no image encoder is asked.

        Returns:
            (K, D) unit rows: ``normalise(image_weight * f_image + text_weight * f_text)``. The text part of what has no word is the mean
            of all known words with ``null_text``, else nothing; a row without either part is zero. With ``image_weight`` 0 the rows are
            the embedder's, bit for bit.

        Raises:
            FrameError: there are not K labels or rows of ``own``, or the picture's embeddings are of another length than the words'.
        """
        where = f"frame {frame.index} (t={frame.timestamp_s})"
        if len(labels) != len(boxes_px) or (own is not None and len(own) != len(boxes_px)):
            got = f"{len(boxes_px)} boxes, {len(labels)} labels" + ("" if own is None else f", {len(own)} embeddings")
            raise FrameError(f"features, {where}: got {got}, wanted as many of each")
        text = self._text(labels)
        looks = self._settings.image_weight > 0 and len(boxes_px) > 0
        image = self._image(frame, boxes_px, own, where) if looks else None
        if image is not None:
            rows = _normalised(self._settings.image_weight * image + self._settings.text_weight * text)
            return rows, self._warn_of_bare_rows(rows)
        return text, (*(self._warn_of_words_only() if looks else ()), *self._warn_of_bare_rows(text))

    @property
    def recipe(self) -> FeatureRecipe:
        """How the features are made: with the detector's own embeddings, where it gives any, else by whoever looks at pictures here."""
        return FeatureRecipe(self._settings.image_weight, self._settings.text_weight, self._looker)

    def _text(self, labels: Sequence[str | None]) -> FloatArray:
        """(K, D) the text part, unit rows or zeros."""
        out = np.zeros((len(labels), self._embedder.size))
        named = [row for row, label in enumerate(labels) if label]
        if named:
            out[named] = self._embedder.embed_text([str(labels[row]) for row in named])
        if self._settings.null_text:
            self._learn(labels)
            out[[row for row, label in enumerate(labels) if not label]] = self._null_text()
        return out

    def _learn(self, labels: Sequence[str | None]) -> None:
        """Without a list of classes the known words are those that were said."""
        fresh = {} if self._settings.classes else dict.fromkeys(label for label in labels if label and label not in self._words)
        if fresh:
            self._words |= fresh
            self._null = None

    def _null_text(self) -> FloatArray:
        """(D,) the normalised mean over all known words; zeros while there is none."""
        if self._null is None:
            known = self._embedder.embed_text(list(self._words)) if self._words else np.zeros((1, self._embedder.size))
            self._null = _normalised(known.mean(axis=0, keepdims=True))[0]
        return self._null

    def _image(self, frame: Frame, boxes_px: FloatArray, own: FloatArray | None, where: str) -> FloatArray | None:
        """(K, D) the image part, unit rows or zeros; None if nothing here can look at pictures."""
        out = np.zeros((len(boxes_px), self._embedder.size))
        missing: BoolArray = np.ones(len(boxes_px), dtype=np.bool_)
        if own is not None:
            missing = np.asarray(~own.any(axis=1), dtype=np.bool_)
            self._looker = self._looker or ("" if missing.all() else "detector")
            out[~missing] = _normalised(self._of_our_size(own[~missing], where))
        if self._encoder is None:
            return None if missing.all() else out
        if missing.any():
            out[missing] = self._of_our_size(self._pictures(frame, boxes_px[missing]), where)
        return out

    def _pictures(self, frame: Frame, boxes_px: FloatArray) -> FloatArray:
        return embedded_pictures(self._encoder, frame, boxes_px, self._settings.crop_margin_px)

    def _of_our_size(self, rows: FloatArray, where: str) -> FloatArray:
        if rows.ndim != 2 or rows.shape[1] != self._embedder.size:
            raise FrameError(
                f"features, {where}: embeddings of pictures are {rows.shape}, those of words (K, {self._embedder.size}); wanted one space, "
                "as a CLIP model has; or set features.image_weight to 0"
            )
        return rows

    def _warn_of_words_only(self) -> tuple[str, ...]:
        return self._once(
            f"features are of words only: embedder {self._embedder.name!r} does not look at pictures and there is no image encoder, "
            f"so that image_weight {self._settings.image_weight:g} has no effect"
        )

    def _warn_of_bare_rows(self, rows: FloatArray) -> tuple[str, ...]:
        """Words alone, with neither pictures nor ``null_text``, are asked for where what has no word is not matched by features."""
        wants_all = self._settings.image_weight > 0 or self._settings.null_text
        if not wants_all or rows.any(axis=1).all():
            return ()
        return self._once(
            "some things have no feature, neither of a word nor of a picture, and match nothing by it: give words in features.classes "
            "(with features.null_text), or an image encoder (an embedder that looks at pictures)"
        )

    def _once(self, warning: str) -> tuple[str, ...]:
        fresh = warning not in self._warned
        self._warned.add(warning)
        return (warning,) if fresh else ()


def sees(candidate: Any) -> bool:
    """Whether it takes pictures; ``isinstance`` of a protocol would ask for its size too, and so load its model."""
    return hasattr(candidate, "embed_crops") or hasattr(candidate, "embed_image")


def embedded_pictures(encoder: Any, frame: Frame, boxes_px: FloatArray, margin_px: int) -> FloatArray:
    """Return (N, D) float64 rows of what is in boxes (N, 4) of a frame; an ``ImageEmbedder`` is shown crops with a margin."""
    if hasattr(encoder, "embed_crops"):
        return np.asarray(encoder.embed_crops(frame, boxes_px), dtype=np.float64)
    return np.asarray(encoder.embed_image(crops(frame.rgb, boxes_px, margin_px)), dtype=np.float64)


def _name_of(encoder: Any) -> str:
    name = getattr(encoder, "name", "")
    return f"{type(encoder).__name__}{f':{name}' if name else ''}"


def crops(rgb: NDArray[np.uint8], boxes_px: FloatArray, margin_px: int) -> list[NDArray[np.uint8]]:
    """Return what is in each box (K, 4) of an image (H, W, 3), with a margin around it where the image reaches so far."""
    height, width = rgb.shape[:2]
    low = np.maximum(np.floor(boxes_px[:, :2]).astype(np.int64) - margin_px, 0)
    high = np.minimum(np.ceil(boxes_px[:, 2:]).astype(np.int64) + margin_px, (width, height))
    return [np.ascontiguousarray(rgb[y0:y1, x0:x1]) for (x0, y0), (x1, y1) in zip(low, high, strict=True)]


def _normalised(rows: FloatArray) -> FloatArray:
    norms = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.asarray(rows / np.where(norms > 1e-12, norms, 1.0), dtype=np.float64)
