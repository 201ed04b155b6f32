"""nibabel_files.py SEED COUNT FOLDER: label images in NIfTI-1 and -2, single and paired, of every type and byte order,
gzipped at every level. files.txt has a line for each: file, file of its labels (int32, first axis fastest), size, affine
(3 x 4, RAS mm) as nibabel reads it back, tolerance relative to the image's diagonal. Ends with 77 if nibabel is not installed."""
import sys

try:
    import nibabel
    import numpy as np
except ImportError:
    sys.exit(77)

seed, count, folder = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
types = [np.int8, np.uint8, np.int16, np.uint16, np.int32, np.uint32, np.int64, np.uint64, np.float32, np.float64]


def turn(random):
    q, r = np.linalg.qr(random.normal(size=(3, 3)))
    return q * np.sign(np.diag(r))


def one(n, random, out):
    size = [int(random.choice([2, 3, 4, 8, 13, 16, 31, 32, 37, 64])) for _ in range(3)]
    type = types[random.integers(len(types))]
    labels = np.zeros(size, np.int32)
    for _ in range(random.integers(1, 5)):
        low = [random.integers(0, s) for s in size]
        high = [random.integers(l, s) + 1 for l, s in zip(low, size)]
        labels[tuple(slice(l, h) for l, h in zip(low, high))] = random.integers(1, 100)
    labels[tuple(random.integers(0, s) for s in size)] = 1
    axes = turn(random) if random.integers(2) else np.eye(3)[random.permutation(3)] * random.choice([-1, 1], 3)
    spacing = random.choice([1, 0.5, 0.4, 375 / 512, 2.5, random.uniform(0.1, 6)], 3)
    affine = np.eye(4)
    affine[:3, :3] = axes * spacing
    affine[:3, 3] = random.uniform(-300, 300, 3)

    version, pair = random.integers(1, 3), random.integers(4) == 0
    kind = {(1, False): nibabel.Nifti1Image, (1, True): nibabel.Nifti1Pair,
            (2, False): nibabel.Nifti2Image, (2, True): nibabel.Nifti2Pair}[version, bool(pair)]
    header = kind.header_class(endianness=random.choice(["<", ">"]))
    header.set_data_dtype(type)
    # nibabel scales an array of floats into whole numbers, perhaps so coarsely that labels are lost.
    steps = 2.0 ** min(8 * np.dtype(type).itemsize, 32) - 2
    if random.integers(3) == 0 and np.dtype(type).kind in "iu" and labels.max() / steps < 0.015:
        image = kind(labels.astype(np.float64), affine, header)
    else:
        image = kind(labels.astype(type), affine, header)
    image.set_data_dtype(type)
    forms = random.integers(3)
    if forms == 0:
        image.set_qform(affine, 1)
        image.set_sform(None, 0)
    elif forms == 1:
        image.set_qform(None, 0)
        image.set_sform(affine, int(random.integers(1, 5)))
    else:
        image.set_qform(affine, 1)
        image.set_sform(affine, int(random.integers(1, 5)))
    nibabel.openers.Opener.default_compresslevel = int(random.integers(1, 10))
    name = f"{n}" + (".hdr" if pair else ".nii") + random.choice(["", ".gz"])
    if pair:
        name = f"{n}" + random.choice([".img", ".img.gz"])
    nibabel.save(image, f"{folder}/{name}")
    labels.ravel(order="F").tofile(f"{folder}/{n}.labels")
    if pair:
        name = name.replace(".img", ".hdr")
    loaded = nibabel.load(f"{folder}/{name}")
    numbers = loaded.affine[:3].ravel()
    # For rotations near a half turn, a quaternion in single precision is accurate to 6e-4 only: libnifti refuses it.
    b, c, d = (float(loaded.header[f"quatern_{x}"]) for x in "bcd")
    slack = 1e-3 if forms == 0 and version == 1 and 1 - b * b - c * c - d * d < 1.1e-7 else 5e-5
    out.write(" ".join([name, f"{n}.labels", *map(str, size), *(repr(float(x)) for x in numbers), str(slack)]) + "\n")


with open(f"{folder}/files.txt", "w") as out:
    for n in range(count):
        one(n, np.random.default_rng([seed, n]), out)
