import tseslint from "typescript-eslint";

export default tseslint.config(
  { ignores: ["node_modules"] },
  {
    files: ["src/**/*.ts"],
    extends: [tseslint.configs.strictTypeChecked],
    languageOptions: { parserOptions: { projectService: true } },
    rules: {
      // Names from files are text, never HTML; nothing is evaluated, stored or fetched.
      "no-eval": "error",
      "no-implied-eval": "off",
      "@typescript-eslint/no-implied-eval": "error",
      "no-restricted-properties": [
        "error",
        { property: "innerHTML", message: "Names from files are text: set textContent." },
        { property: "outerHTML", message: "Names from files are text: set textContent." },
        { property: "insertAdjacentHTML", message: "Names from files are text: set textContent." },
      ],
      "no-restricted-globals": ["error", "localStorage", "sessionStorage", "indexedDB", "fetch", "XMLHttpRequest"],
      "no-console": "error",
      // Typed arrays are indexed within their bounds everywhere: `a[i]!` says so without a test at run time.
      "@typescript-eslint/no-non-null-assertion": "off",
      "@typescript-eslint/restrict-template-expressions": ["error", { allowNumber: true }],
    },
  },
  // Answers go to the study's own computer, which serves the page; a camera is asked for its video. Nothing else fetches.
  { files: ["src/study/recorder.ts", "src/live/camera.ts"], rules: { "no-restricted-globals": ["error", "localStorage", "sessionStorage", "indexedDB", "XMLHttpRequest"] } },
);
