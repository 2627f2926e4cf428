// Colours and dashes of trajectories, those of Okabe and Ito (2008) as in hpop/view/style.py, on the dark page.
export const TRACK_COLOURS = ["#F28E2B", "#56B4E9", "#009E73", "#CC79A7", "#F0E442", "#E8E8E8", "#B07AA1", "#9C755F"] as const;
export const TRACK_DASHES: readonly (readonly number[])[] = [[], [7, 4], [2, 3], [9, 3, 2, 3], [4, 4], [12, 4], [2, 6], [6, 2]];

export function colourOfTrack(i: number): string {
  return TRACK_COLOURS[i % TRACK_COLOURS.length]!;
}

export function dashesOfTrack(i: number): readonly number[] {
  return TRACK_DASHES[i % TRACK_DASHES.length]!;
}
