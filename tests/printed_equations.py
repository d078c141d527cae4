"""Eq. 3-7 as printed, one candidate after another: the oracle beside `safe_region_labels`."""

import numpy as np

from drake_pregrasp.quality.grasp_quality import grasp_matrix


def gaussian(q, mu, Sigma):
    """Eq. 3."""
    d = q - mu
    scale = np.sqrt(np.linalg.det(Sigma) * (2 * np.pi) ** len(q))
    return np.exp(-d @ np.linalg.inv(Sigma) @ d / 2) / scale


def measures(r, nhat, model, length):
    """Eq. 5-7 of contacts at lever arms r, by the singular values of the whole G."""
    found = np.linalg.svd(grasp_matrix(r, nhat, model, length=length), compute_uv=False)
    sigma = np.append(found, np.zeros(6 - len(found)))
    if sigma[-1] < 1e-3 * sigma[0]:
        sigma[-1] = 0
    return {"msv": sigma[-1], "gii": sigma[-1] / sigma[0], "vew": np.prod(sigma)}


def weights(selection, i, name, reading="hand", model="complete", length=1.0):
    """b_n of the candidates in region i."""
    surface, b = selection.surface, []
    active = selection.regions.sizes() > 0 if reading == "hand" else [i]
    for n in selection.regions.members(i):
        q = surface.p_OQ[n]
        if name == "position":
            b.append(gaussian(q, surface.p_OCoM, selection.covariance_O))
            continue
        contacts, nhat = selection.p_OC.copy(), surface.project(selection.p_OC)[1]
        contacts[i], nhat[i] = q, surface.nhat_OQ[n]
        r = (contacts - surface.p_OCoM)[active]
        b.append(measures(r, nhat[active], model, length)[name])
    return np.array(b)


def centroid(selection, i, name, *, stretch=True):
    """Eq. 4 over region i, each candidate with its area."""
    surface, members = selection.surface, selection.regions.members(i)
    b = weights(selection, i, name)
    if stretch and name != "position":
        b = b - b.min()
    b = b * surface.areas[members]
    if not b.sum() > 1e-12 * surface.areas[members].sum():
        b = surface.areas[members]
    return b @ surface.p_OQ[members] / b.sum()
