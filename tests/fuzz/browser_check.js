// Reads changed replays as the page does.
async function usePage() {
  const verdicts = [];
  for (const replay of REPLAYS)
    verdicts.push(await readReplay(replay).then(() => "read", error => error instanceof BadReplay ? error.message : `not told: ${error.stack}`));
  return {verdicts};
}
